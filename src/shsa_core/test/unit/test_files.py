"""Files: what is none is refused by its name and kept nobody waiting; who can write what runs."""
import os
import pathlib
import socket
from typing import Any, Callable, Dict, Iterator

import pytest

from shsa_core.cli.main import main
from shsa_core.errors import ModelError
from shsa_core.files.ontology_file import load_ontology
from shsa_core.files.regular import open_to_append, read_text, written_by_others
from shsa_core.files.som_file import load_som, read_som, refuse_others_commands

READERS: Dict[str, Callable[[str], object]] = {
    "ontology": load_ontology,
    "som": load_som,
}
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")


@pytest.fixture
def odd(tmp_path: pathlib.Path) -> Iterator[pathlib.Path]:
    """A folder with all sorts of things that are not files of text."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "to_pipe").symlink_to("pipe")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "letters").write_bytes(b"a: 1\nb: \xff\xfe\n")
    (tmp_path / "zero").write_bytes(b"a: 1\nb: \0\n")
    with open(tmp_path / "huge", "wb") as file:
        file.truncate(10**9)
    with socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(tmp_path / "socket"))
        yield tmp_path


ODD = [
    ("pipe", "it is a pipe, and no file"),
    ("to_pipe", "it is a pipe, and no file"),
    ("folder", "Is a directory"),
    ("socket", "it is a socket, and no file"),
    ("/dev/zero", "it is a device, and no file"),
    ("/dev/tty", "it is a device, and no file"),
    ("loop", "cannot be read"),
    ("nowhere", "cannot be read: No such file"),
    ("nul\0l", "cannot be read"),
    ("huge", "larger than|longer than"),
    ("letters", "letters:2: is not UTF-8|letters:1: is not a line"),
    ("zero", "zero:2: holds a zero byte|zero:1: is not a line"),
]


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name, why", ODD)
def test_what_is_no_file_of_text_is_refused_by_its_name(
    odd: pathlib.Path, reader: str, name: str, why: str
) -> None:
    with pytest.raises(ModelError, match=why) as caught:
        READERS[reader](str(odd / name))
    assert name.rpartition("/")[2].replace("\0", r"\x00") in caught.value.where


@pytest.mark.parametrize("name", ["pipe", "folder", "huge", "zero", "/dev/zero"])
def test_the_command_line_names_it(odd: pathlib.Path, name: str, capsys: Any) -> None:
    path = str(odd / name)
    assert main(["check", path]) == 1
    assert main(["find", "a", "--ontology", path, "--som", path]) == 2
    assert main(["replay", path]) == 2
    printed = capsys.readouterr()
    assert path in printed.out and printed.err.count(path) == 2


def test_a_file_that_is_too_large_is_not_read(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "large"
    file.write_text("#" * 100)
    assert read_text(str(file), 100) == "#" * 100
    file.write_text("#" * 101)
    with pytest.raises(ModelError, match="large: is larger than 100 bytes"):
        read_text(str(file), 100)
    with pytest.raises(ModelError, match="is larger than 100 bytes"):
        read_text("/proc/self/maps", 100)  # a file that does not say how large it is


def test_a_log_is_written_for_us_alone(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "log"
    for text in (b"a", b"b"):
        descriptor = open_to_append(str(path))
        os.write(descriptor, text)
        os.close(descriptor)
    assert path.read_bytes() == b"ab" and path.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("name", ["link", "dangling", "pipe", "folder", "second", "/dev/null"])
def test_a_log_is_written_to_a_file_of_ours_alone(tmp_path: pathlib.Path, name: str) -> None:
    target = tmp_path / "target"
    target.write_text("kept")
    (tmp_path / "link").symlink_to(target)
    (tmp_path / "dangling").symlink_to(tmp_path / "new")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    if name == "second":
        os.link(target, tmp_path / "second")
    with pytest.raises(OSError):
        open_to_append(str(tmp_path / name))
    assert target.read_text() == "kept" and not (tmp_path / "new").exists()


@as_root
def test_a_log_of_another_user_is_not_written_to(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "log"
    path.write_text("kept")
    os.chown(path, 65534, 65534)
    with pytest.raises(OSError, match="another user"):
        open_to_append(str(path))
    assert path.read_text() == "kept"


SERVICE = """services:
  a:
    topic: /a
    type: std_msgs/Float64
    node: /a_node
    period: 0.1
    provides: {x: {field: data}}
"""


@pytest.fixture
def som(tmp_path: pathlib.Path) -> pathlib.Path:
    folder = tmp_path / "robot"
    folder.mkdir(mode=0o755)
    path = folder / "som.yaml"
    path.write_text(SERVICE + "    last_resort: {command: [/bin/true]}\n")
    path.chmod(0o644)
    return path


def refusal(path: pathlib.Path) -> str:
    try:
        refuse_others_commands(read_som(str(path)), str(path))
    except ModelError as error:
        return str(error)
    return ""


def test_a_som_that_starts_programs_is_believed_where_only_we_can_write_it(
    som: pathlib.Path,
) -> None:
    assert refusal(som) == ""  # through /tmp: nobody can replace what is another's there
    som.chmod(0o646)
    assert "it starts programs (a), and everybody can write " + str(som) in refusal(som)
    for text in ("policy: restart", "policy: restart_and_substitute"):
        som.write_text(SERVICE + f"    {text}\n")
        assert "chmod o-w" in refusal(som)
    for text in ("policy: substitute", "policy: advise", "last_resort: {values: {x: 0}}"):
        som.write_text(SERVICE + f"    {text}\n")
        assert refusal(som) == ""


def test_every_folder_on_the_way_counts(som: pathlib.Path, tmp_path: pathlib.Path) -> None:
    som.parent.chmod(0o757)
    assert f"everybody can write {som.parent}" in refusal(som)
    som.parent.chmod(0o1777)
    assert refusal(som) == ""
    som.parent.chmod(0o755)
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    link = tmp_path / "open" / "link.yaml"
    link.symlink_to(som)
    assert f"everybody can write {tmp_path / 'open'}" in refusal(link)
    again = tmp_path / "again.yaml"
    again.symlink_to("open/../open/link.yaml")
    assert f"everybody can write {tmp_path / 'open'}" in refusal(again)
    inside = som.parent / "inside"
    inside.mkdir()
    beside = tmp_path / "beside"
    beside.symlink_to(inside)
    (tmp_path / som.name).write_text("")
    som.chmod(0o646)
    assert f"everybody can write {som}" in refusal(beside / ".." / som.name), "as open() reads it"
    som.chmod(0o644)
    assert "cannot be looked at" in written_by_others(str(tmp_path / "nowhere"))


def test_check_warns_of_it(som: pathlib.Path, capsys: Any) -> None:
    ontology = som.parent / "ontology.yaml"
    ontology.write_text("properties:\n  x:\n")
    command = ["check", str(ontology), "--som", str(som)]
    assert main(command) == 0 and "starts programs" not in capsys.readouterr().out
    som.chmod(0o646)
    assert main(command) == 0 and "keep it from others" in capsys.readouterr().out


@as_root
def test_groups_and_owners_count(som: pathlib.Path) -> None:
    os.chown(som, 0, 4)  # adm
    som.chmod(0o664)
    if "adm" in refusal(som):
        assert "the group adm can write" in refusal(som)
    os.chown(som, 0, 54321)
    assert "the group 54321 can write" in refusal(som)
    os.chown(som, 0, 0)
    assert refusal(som) == ""  # nobody else is in our own group
    os.chown(som, 65534, 0)
    assert "belongs to nobody, who is neither root" in refusal(som)
    os.chown(som, 0, 0)
    os.chown(som.parent, 65534, 0)
    assert f"{som.parent} belongs to nobody" in refusal(som)


def test_a_file_of_this_repository_with_commands_is_refused_by_the_reconfigurator(
    som: pathlib.Path,
) -> None:
    reconfigurator = pytest.importorskip("shsa_core.ros.reconfigurator")
    ontology = som.parent / "ontology.yaml"
    ontology.write_text("properties:\n  x:\n")
    assert reconfigurator.read_models(str(ontology), str(som))[1].services
    som.chmod(0o666)
    with pytest.raises(ModelError, match="everybody can write"):
        reconfigurator.read_models(str(ontology), str(som))
