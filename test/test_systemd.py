"""The systemd units are valid, and their sandbox is what docs/howto/secure.md says."""
import configparser
import re
import shutil
import subprocess
from pathlib import Path
from typing import Dict, Tuple

import pytest

FOLDER = Path(__file__).resolve().parent.parent / "src" / "shsa_core" / "systemd"
UNITS = sorted(path.name for path in FOLDER.iterdir())
MOST_EXPOSED = 2.0
"""Of 10, as `systemd-analyze security` weighs it; a unit that says nothing has 9.6."""
systemd = shutil.which("systemd-analyze")


class _Several(Dict[str, str]):
    """Keys may stand several times, as Environment does: the values are joined."""

    def __setitem__(self, key: str, value: object) -> None:
        if isinstance(value, list) and isinstance(self.get(key), list):
            value = [*self[key], *value]
        super().__setitem__(key, value)  # type: ignore[assignment]


def unit(name: str) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(
        strict=False, interpolation=None, dict_type=_Several, delimiters=("=",)
    )
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string((FOLDER / name).read_text("utf-8"))
    return parser


def test_there_are_units_for_the_master_and_for_healing() -> None:
    assert UNITS == ["roscore.service", "shsa.service"]


@pytest.mark.parametrize("name", UNITS)
def test_it_runs_with_no_more_rights_than_it_needs(name: str) -> None:
    service = unit(name)["Service"]
    for key, value in {
        "User": "ros",
        "UMask": "0077",
        "NoNewPrivileges": "yes",
        "CapabilityBoundingSet": "",
        "IPAddressDeny": "any",
        "IPAddressAllow": "localhost",
        "ProtectSystem": "strict",
        "ProtectHome": "yes",
        "KillSignal": "SIGINT",
    }.items():
        assert service[key] == value, key
    assert "ROS_IP=127.0.0.1" in service["Environment"]
    assert re.match(r"/\S+/env\.sh ros(core|launch)\b", service["ExecStart"])


@pytest.mark.skipif(systemd is None, reason="there is no systemd-analyze here")
@pytest.mark.parametrize("name", UNITS)
def test_systemd_finds_nothing_wrong(name: str, tmp_path: Path) -> None:
    for each in UNITS:  # the program is not installed here
        text = (FOLDER / each).read_text("utf-8").replace("/opt/shsa/env.sh", "/bin/true")
        (tmp_path / each).write_text(text)
    status, said = _analyze("verify", str(tmp_path / name))
    assert not [line for line in said.splitlines() if str(tmp_path) in line], said
    status, said = _analyze("security", "--offline=true", str(tmp_path / name))
    if "unrecognized option" not in said:  # systemd 245 has none
        found = re.search(r"exposure level for \S+: ([0-9.]+)", said)
        assert found is not None and float(found.group(1)) <= MOST_EXPOSED, said


def _analyze(*words: str) -> Tuple[int, str]:
    done = subprocess.run(
        [str(systemd), "--no-pager", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    return done.returncode, done.stdout.decode("utf-8", "replace")
