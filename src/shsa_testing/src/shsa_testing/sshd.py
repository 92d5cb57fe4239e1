"""An sshd for a computer made of namespaces: its configuration, host key and password."""
import os
import shutil
import subprocess
from pathlib import Path

CONFIGURATION = """Port 22
HostKey {folder}/host_key
PidFile none
AuthorizedKeysFile .ssh/authorized_keys
StrictModes no
UsePAM no
UseDNS no
PermitRootLogin yes
MaxStartups 100
"""


def find_sshd() -> str:
    """Return the path of sshd; empty if there is none. tools/fetch_sshd fetches one."""
    found = shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    return os.path.abspath(found) if found else ""


def write_sshd(folder: Path, user: str, password: str) -> None:
    """Write what an sshd needs into `folder`, which lets `user` in by `password`.

    The file `shadow` there, of mode 0600, gets the user's line. Raises CalledProcessError.
    """
    key = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / "host_key")]
    subprocess.run(key, check=True)
    hashed = subprocess.run(
        ["openssl", "passwd", "-6", "-stdin"],
        check=True,
        input=password,
        stdout=subprocess.PIPE,
        universal_newlines=True,
    ).stdout.strip()
    (folder / "shadow").write_text(f"{user}:{hashed}:20000:0:99999:7:::\n")
    (folder / "sshd_config").write_text(CONFIGURATION.format(folder=folder))
