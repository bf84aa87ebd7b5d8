"""Files with secrets: who may read them, by their mode or as a credential of systemd."""

from pathlib import Path

import pytest

from onboard.config import LinkConfig, signing_key
from onboard.sinks.secrets import CREDENTIALS, is_private, secret
from onboard.sinks.sink import SinkError


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Of the credentials of a service: root's, as its access list shows, for the service's user."""
    made = tmp_path / "credentials"
    made.mkdir()
    made.chmod(0o750)
    monkeypatch.setenv(CREDENTIALS, str(made))
    return made


def put(path: Path, mode: int) -> Path:
    path.write_text(" a passphrase\n", encoding="utf-8")
    path.chmod(mode)
    return path


def test_a_secret_is_for_its_owner_alone(tmp_path: Path) -> None:
    file = tmp_path / "key"
    assert secret(str(put(file, 0o600)), "zenoh.password_file") == "a passphrase"
    for mode in (0o640, 0o604, 0o610, 0o660):
        with pytest.raises(SinkError, match=r"zenoh.password_file .*key: others can read it; run chmod 600 on it"):
            secret(str(put(file, mode)), "zenoh.password_file")
    with pytest.raises(SinkError, match=r"zenoh.password_file .*: Is a directory"):
        secret(str(tmp_path), "zenoh.password_file")


def test_a_credential_of_systemd_may_have_an_access_list(folder: Path) -> None:
    """0440 is what the mode shows of a file of root's that the service's user may read."""
    file = put(folder / "signing.key", 0o440)
    assert is_private(file)
    assert signing_key(LinkConfig(name="fc", url="udpin:127.0.0.1:0", key_file=str(file))) is not None


def test_what_is_beside_the_credentials_is_none(folder: Path, tmp_path: Path) -> None:
    outside = put(tmp_path / "signing.key", 0o440)
    assert not is_private(outside)
    link = folder / "signing.key"
    link.symlink_to(outside)
    assert not is_private(link)
    assert not is_private(folder / ".." / "signing.key")


def test_a_folder_of_credentials_that_others_can_enter_protects_nothing(folder: Path) -> None:
    file = put(folder / "signing.key", 0o440)
    folder.chmod(0o755)
    assert not is_private(file)
