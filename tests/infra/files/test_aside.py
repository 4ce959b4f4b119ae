"""Files that are put into place when they are whole, on file systems with hard links and without."""

import errno
import os

import pytest

from infra.files.aside import make_aside, put_all_in_place


@pytest.fixture(params=["links", "no links"])
def disk(request, monkeypatch):
    if request.param == "no links":

        def link(*_):
            raise OSError(errno.EPERM, "no hard links here")

        monkeypatch.setattr(os, "link", link)


def test_files_come_into_place_and_never_over_another(tmp_path, disk):
    folder = tmp_path / "new" / "out"
    hidden = make_aside(folder)
    for name in ("a", "last", "z"):
        (hidden / name).write_text(name)
    (folder / "z").write_text("was there")
    with pytest.raises(FileExistsError):
        put_all_in_place(hidden, folder, last="last")
    assert (folder / "z").read_text() == "was there"
    assert not (folder / "last").exists()
    (folder / "z").unlink()
    put_all_in_place(hidden, folder, last="last")
    assert {path.name: path.read_text() for path in folder.iterdir() if path.is_file()} == {
        "a": "a",
        "last": "last",
        "z": "z",
    }
    assert list(hidden.iterdir()) == []
