"""The page of requirements names tests that exist."""

import re
from pathlib import Path


def test_every_named_test_and_command_exists():
    page = Path("docs/reliability.md").read_text(encoding="utf-8")
    written = {
        name
        for path in Path("tests").rglob("test_*.py")
        for name in re.findall(r"def (test_\w+)", path.read_text(encoding="utf-8"))
    }
    named = set(re.findall(r"`(test_\w+)`", page))
    assert len(named) > 40
    assert named <= written, named - written
    for path in re.findall(r"`(tests/[\w/]+\.py)`", page):
        assert Path(path).is_file(), path
    for module in re.findall(r"python -m (bench[.\w]+\w|sim\.\w+)", page):
        path = Path(module.replace(".", "/"))
        assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), module
    for result in re.findall(r"`(\w+\.md)`", page):
        assert Path("bench/results", result).is_file(), result


def test_every_requirement_has_a_test_that_is_not_slow():
    marked = re.compile(r"^@pytest\.mark\.slow\n(?:[@ )].*\n)*(?:async )?def (test_\w+)", re.MULTILINE)
    slow = {
        name for path in Path("tests").rglob("test_*.py") for name in marked.findall(path.read_text(encoding="utf-8"))
    }
    rows = re.findall(r"^\| \d+.*$", Path("docs/reliability.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    named = [set(re.findall(r"`(test_\w+)`", row)) for row in rows]
    assert len(slow) > 200 and len(rows) > 20 and not [tests for tests in named if tests and tests <= slow]


def test_every_requirement_has_a_row():
    page = Path("docs/reliability.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+)[abc]? \|", page, flags=re.MULTILINE)
    assert {int(number) for number in rows} == set(range(1, 21))


def test_what_is_told_of_the_attacks_is_what_was_measured():
    results = Path("bench/results/attacks.md").read_text(encoding="utf-8")
    cases = [row.split(" | ") for row in re.findall(r"^\| (?!attack \||---)(.*) \|$", results, flags=re.MULTILINE)]
    held = sum(case[8] == "held" for case in cases)
    assert f"\n{held} of {len(cases)} cases held." in results
    assert f"{len(cases)} cases, of which {held} are held" in Path("docs/reliability.md").read_text(encoding="utf-8")
