from pathlib import Path

import pytest

from gcs.cli.screen_options import ScreenOptions, screen_options
from gcs.errors import ConfigError
from tests.support.command_line import run_gcs


@pytest.fixture
def config(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    path = tmp_path / "rollcall" / "config.toml"
    path.parent.mkdir()
    return path


def test_the_page_for_operators_has_the_values_without_either(config):
    page = (Path(__file__).parents[3] / "docs" / "operations.md").read_text()
    config.write_text("[ui]\n" + page.partition("[ui]\n")[2].partition("```")[0])
    assert screen_options(None) == ScreenOptions()


def test_the_command_line_counts_more_than_the_file(config):
    assert screen_options(None) == ScreenOptions()
    config.write_text('[ui]\ntheme = "light"\nfps = 4\n')
    assert screen_options(None) == ScreenOptions(theme="light", fps=4.0)
    given = ["theme=high-contrast", "bell=true", "graphics=octants", "graphics=blocks"]
    assert screen_options(given) == ScreenOptions(theme="high-contrast", fps=4.0, bell=True, graphics="blocks")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("theme", "--ui theme: write KEY=VALUE"),
        ("theme=pink", "--ui: theme is 'pink'; 'dark' or 'high-contrast' or 'light' is needed"),
        ("fsp=2", "--ui: unknown key 'fsp'; did you mean fps?"),
        ("graphics=" + 3000 * "[", "--ui: graphics is"),
        ("bell=yes", "--ui: bell is 'yes'; true or false is needed"),
        *((f"fps={value}", "--ui: fps is") for value in ("0", "1e9", "nan", "inf", "-1", "many")),
    ],
)
def test_a_value_that_there_is_none_of_is_told(config, given, told):
    with pytest.raises(ConfigError, match=told):
        screen_options([given])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[ui\n", "not valid TOML"),
        ("[ui]\nfps = 99\n", r"config.toml: \[ui\]: fps is 99"),
        ("[screen]\n", "unknown key 'screen'; known are ui"),
        ("[ui]\nfps = nan\n", "fps is nan"),
    ],
)
def test_a_file_that_is_wrong_is_told_by_its_name(config, text, told):
    config.write_text(text)
    with pytest.raises(ConfigError, match=told):
        screen_options(["theme=light"])


def test_a_user_without_a_home_has_no_file(monkeypatch):
    for name in ("HOME", "XDG_CONFIG_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", {}.__getitem__)
    assert screen_options(["bell=true"]) == ScreenOptions(bell=True)


def test_a_flight_without_a_screen_does_not_read_them(config, tmp_path):
    config.write_text("[screen]\n")
    code, _, told = run_gcs("fly", tmp_path / "none.toml", "--headless")
    assert code == 2 and "none.toml" in told and "config.toml" not in told
    code, _, told = run_gcs("fly", tmp_path / "none.toml", "--headless", "--ui", "theme=pink")
    assert code == 2 and "config.toml: unknown key 'screen'" in told


def test_old_options_go_on_for_a_release(config, tmp_path):
    code, _, told = run_gcs("replay", tmp_path / "none", "--theme", "light", "--fps=2", "--graphics", "pink")
    assert code == 2
    assert [line.split(";")[0] for line in told.splitlines()[:3]] == [
        "gcs: --theme is now --ui theme=VALUE",
        "gcs: --fps is now --ui fps=VALUE",
        "gcs: --graphics is now --ui graphics=VALUE",
    ]
    assert "graphics is 'pink'" in told
