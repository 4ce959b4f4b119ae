import copy
import io
import os
import pickle
import subprocess
import sys
import traceback

import pytest
from rich.console import Console
from rich.traceback import Traceback

from mavlink.errors import SigningError
from mavlink.signing.keys import FLEET, Key, KeyRing, key_path, passphrase_secret, read_ring, write_key
from mavlink.signing.signer import Signer
from mavlink.signing.store import StreamStore
from mavlink.signing.verifier import Verifier
from tests.support.signed_vehicles import T0, Sender, ring_of, secret_of, shown_anywhere

SECRET = secret_of("hidden")


def told(error):
    """A traceback of the program with the values of all local names, as Python and as the screens draw it."""
    tb = error.__traceback__
    while tb.tb_frame.f_code.co_filename == __file__:  # the test itself knows what it hides
        tb = tb.tb_next
    plain = traceback.TracebackException(type(error), error, tb, capture_locals=True)
    screen = Console(file=io.StringIO(), width=400)
    screen.print(
        Traceback.from_exception(
            type(error), error, tb, show_locals=True, locals_max_length=1000, locals_max_string=1000
        )
    )
    return "".join(plain.format()) + screen.file.getvalue()


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "keys"
    folder.mkdir(mode=0o700)
    return folder


def test_written_and_read_again(folder):
    for system_id in (1, 7, 255, FLEET):
        path, key = write_key(folder, system_id, secret_of(system_id))
        assert path == key_path(folder, system_id)
        assert path.stat().st_mode & 0o777 == 0o600
        assert path.read_text() == secret_of(system_id).hex() + "\n"
        assert key.fingerprint == Key(secret_of(system_id)).fingerprint
    ring = read_ring(folder)
    assert sorted(ring.keys) == [1, 7, 255]
    assert len(ring) == 4
    covered = b"anything"
    assert ring.key_of(7).signature(covered) == Key(secret_of(7)).signature(covered)
    assert ring.key_of(8).fingerprint == Key(secret_of(FLEET)).fingerprint
    assert ring.default is ring.key_of(9)


def test_a_folder_is_made_for_its_owner_only(tmp_path):
    path, _ = write_key(tmp_path / "a" / "keys", 7, SECRET)
    assert path.parent.stat().st_mode & 0o077 == 0


def test_never_overwritten(folder):
    path, _ = write_key(folder, 7, SECRET)
    with pytest.raises(SigningError, match="never overwritten"):
        write_key(folder, 7, secret_of(1))
    assert path.read_text().strip() == SECRET.hex()


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o660, 0o620, 0o601])
def test_a_key_that_others_may_read_is_refused(folder, mode):
    path, _ = write_key(folder, 7, SECRET)
    path.chmod(mode)
    with pytest.raises(SigningError, match=f"7.key: others may read this key .mode {mode:o}.; run: chmod 600") as error:
        read_ring(folder)
    command = str(error.value).split("run: ")[1]
    subprocess.run(command, shell=True, check=True)
    assert 7 in read_ring(folder).keys


def test_a_folder_that_others_may_write_is_refused(folder):
    write_key(folder, 7, SECRET)
    folder.chmod(0o777)
    with pytest.raises(SigningError, match="run: chmod 700"):
        read_ring(folder)


@pytest.mark.parametrize(
    "text", [b"", b"zz" * 32, b"ab" * 31, b"ab" * 33, b"00" * 32, SECRET, b"\xff\xfe" * 40, b"ab" * 5000]
)
def test_a_file_without_a_key_is_refused(folder, text):
    path = key_path(folder, 7)
    path.write_bytes(text)
    path.chmod(0o600)
    with pytest.raises(SigningError, match="holds no key") as error:
        read_ring(folder)
    assert not shown_anywhere(told(error.value), SECRET)


@pytest.mark.parametrize("name", ["0.key", "256.key", "07.key", "seven.key", "-1.key", "1.5.key", "².key"])
def test_a_file_of_nobody_is_refused(folder, name):
    (folder / name).write_text(SECRET.hex())
    (folder / name).chmod(0o600)
    with pytest.raises(SigningError, match="whose key"):
        read_ring(folder)


def test_a_pipe_in_a_keys_place_is_refused_at_once(folder):
    os.mkfifo(folder / "11.key", 0o600)
    with pytest.raises(SigningError, match=r"11\.key: cannot be read"):
        read_ring(folder)


def test_other_files_are_left_alone(folder):
    for name in ("streams.0", "notes.txt", "7.key~", ".8.key.swp"):
        (folder / name).write_text("x")
    assert not read_ring(folder)


def test_no_folder(tmp_path):
    with pytest.raises(SigningError, match="gcs keys new"):
        read_ring(tmp_path / "absent")
    with pytest.raises(SigningError, match="cannot be read"):
        (tmp_path / "file").write_text("")
        read_ring(tmp_path / "file")


@pytest.mark.parametrize("secret", [b"", b"short", bytes(31), bytes(32), b"k" * 33])
def test_not_a_key(secret):
    with pytest.raises(SigningError, match=r"32 bytes|zeros"):
        Key(secret)


def test_a_passphrase_makes_the_key_that_others_make():
    # echo -n "correct horse" | sha256sum
    made = subprocess.run(
        [sys.executable, "-c", "import hashlib;print(hashlib.new('sha256', b'correct horse').hexdigest())"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert passphrase_secret("correct horse").hex() == made.stdout.strip()
    assert len(passphrase_secret("Schlüssel")) == 32


# Nothing shows a key


def holders(folder):
    key, ring = Key(SECRET), KeyRing(keys={7: Key(SECRET)}, default=Key(SECRET))
    store = StreamStore(folder)
    store.close()
    return [key, ring, Verifier(ring, streams=store.streams), Signer(key), store, {7: key}, (ring,)]


def test_no_repr_shows_a_key(folder):
    for holder in holders(folder):
        assert not shown_anywhere(f"{holder!r} {holder} {holder:}" + repr(getattr(holder, "__dict__", "")), SECRET)
    assert repr(Key(SECRET)) == f"Key({Key(SECRET).fingerprint})"
    assert Key(SECRET).fingerprint not in SECRET.hex()


def test_a_key_cannot_be_pickled_or_copied_deeply(folder):
    for holder in (Key(SECRET), ring_of(7), Verifier(ring_of(7)), Signer(Key(SECRET))):
        with pytest.raises(TypeError, match="pickle"):
            pickle.dumps(holder)
    with pytest.raises(TypeError, match="pickle"):
        copy.deepcopy(ring_of(7))


def test_no_traceback_shows_a_key(folder, monkeypatch):
    checker, signer = holders(folder)[2:4]

    def fail(*_):
        raise RuntimeError("deep inside")

    packet = Sender(7, secret=SECRET).packet()
    monkeypatch.setattr("mavlink.signing.verifier.compare_digest", fail)
    with pytest.raises(RuntimeError) as error:
        checker.check(packet)
    text = told(error.value)
    assert "key = Key(" in text
    assert not shown_anywhere(text, SECRET)
    monkeypatch.setattr("mavlink.signing.signer.checksum", fail)
    with pytest.raises(RuntimeError) as error:
        signer.sign(Sender(7, signs=False).frame(), T0)
    assert not shown_anywhere(told(error.value), SECRET)


def test_no_error_of_a_key_file_shows_it(folder, tmp_path, monkeypatch):
    path, _ = write_key(folder, 7, SECRET)
    errors = []
    path.chmod(0o644)
    with pytest.raises(SigningError) as error:
        read_ring(folder)
    errors.append(error.value)
    path.chmod(0o600)
    path.write_text(SECRET.hex()[:-1])
    with pytest.raises(SigningError) as error:
        read_ring(folder)
    errors.append(error.value)
    assert not any(shown_anywhere(told(e), SECRET) for e in errors)
    for spoil in ("exists", "full", "no folder"):
        target = folder if spoil == "exists" else tmp_path / spoil
        if spoil == "no folder":
            target.write_text("")
        if spoil == "full":
            monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        with pytest.raises(SigningError) as error:
            write_key(target, 7, SECRET)
        assert not shown_anywhere(told(error.value), SECRET), spoil
    assert not key_path(tmp_path / "full", 7).exists()
