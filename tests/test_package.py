"""What is published reads without the repository, and says what is tested."""

from __future__ import annotations

import re
import tomllib

from tests.support.bundled import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_description_links_to_nothing_that_only_the_repository_has():
    text = (ROOT / PROJECT["readme"]).read_text(encoding="utf-8")
    prose = re.sub(r"```.*?```|`[^`\n]*`", "", text, flags=re.DOTALL)
    links = re.findall(r"\]\(([^)]*)\)|\]:\s*(\S+)|(?:src|href)=[\"']([^\"']*)", prose)
    assert all(link.startswith(("https://", "#")) for found in links for link in found if link)
    assert "docs/" not in text and ".venv" not in text


def test_the_python_versions_told_are_those_that_ci_tries():
    told = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if re.fullmatch(r".*:: 3\.\d+", c)]
    tried = re.search(r"python: \[(.*)\]", (ROOT / ".github" / "workflows" / "ci.yml").read_text())
    assert told == re.findall(r"\d\.\d+", tried[1]) == ["3.11", "3.12", "3.13", "3.14"]
    oldest = PROJECT["requires-python"].removeprefix(">=")
    assert oldest.startswith(told[0]) and oldest in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def test_whoever_looks_for_it_finds_it_and_may_use_it():
    assert PROJECT["license"] == "MIT"
    assert len(PROJECT["keywords"]) >= 5
    assert PROJECT["scripts"]["gcs"] == "gcs.cli.start:main"


def test_the_changelog_has_this_version_in_the_form_that_the_release_looks_for():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = re.findall(r"^## \[(.*?)\](.*)$", text, re.MULTILINE)
    assert versions[0] == ("Unreleased", "")
    assert PROJECT["version"] in dict(versions)
    assert all(re.fullmatch(r" - \d{4}-\d\d-\d\d", date) for _, date in versions[1:])
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert set(re.findall(r"^### (.*)$", text, re.MULTILINE)) <= kinds


def test_every_week_runs_what_bench_all_runs():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    words = re.search(r"^BENCHES := (.*)$", makefile, re.MULTILINE)[1]
    words = re.sub(r"\$\(addprefix (\w+\.),(.*?)\)", lambda m: " ".join(m[1] + word for word in m[2].split()), words)
    weekly = (ROOT / ".github" / "workflows" / "weekly.yml").read_text(encoding="utf-8")
    assert re.findall(r"^ +- ([\w.]+)$", weekly, re.MULTILINE) == words.split()
    for name in words.split():
        path = ROOT / "bench" / ("fuzz" if name.startswith("fuzz.") else name.replace(".", "/"))
        assert path.with_suffix(".py").is_file() or (path / "__main__.py").is_file(), name


def test_ci_runs_what_make_test_leaves_out():
    assert "\nmake test\nmake test-slow\n" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
