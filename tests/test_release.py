"""A release: which versions may follow, what it writes, and that a failed one leaves everything as it was."""

import subprocess
from datetime import date
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DAY = date(2027, 1, 31)
CHANGELOG = "# Changelog\n\nWhat changed.\n\n## 0.2.0 – unreleased\n\n- Something.\n\n## 0.1.0 – 2026-01-01\n\n- All.\n"


@pytest.fixture(scope="module")
def release():
    """The script, as a module."""
    loader = SourceFileLoader("release", str(ROOT / ".ci/release"))
    spec = spec_from_loader("release", loader)
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module


@pytest.fixture
def checkout(tmp_path):
    """A repository with the files that a release changes."""
    (tmp_path / "simrob_drake").mkdir()
    (tmp_path / "simrob_drake/__init__.py").write_text(
        '"""A package."""\n\n__version__ = "0.1.0"\n'
    )
    (tmp_path / "CITATION.cff").write_text((ROOT / "CITATION.cff").read_text())
    (tmp_path / "CHANGELOG.md").write_text(CHANGELOG)
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "config", "user.email", "nobody@example.org")
    git(tmp_path, "config", "user.name", "Nobody")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "--quiet", "--message", "Begin")
    return tmp_path


def git(folder, *words):
    return subprocess.run(
        ["git", *words], cwd=folder, check=True, text=True, stdout=subprocess.PIPE
    ).stdout


class Steps:
    """Runs git, and notes what else is asked for; a step named ``failing`` fails."""

    def __init__(self, folder, failing=""):
        self.folder, self.failing = folder, failing
        self.done = []

    def __call__(self, *words):
        if words[0] == "git":
            return git(self.folder, *words[1:])
        self.done.append(words)
        if words[0] == self.failing:
            raise subprocess.CalledProcessError(1, words)
        return ""


def test_a_release_writes_the_version_and_its_day_and_tags_them(release, checkout):
    steps = Steps(checkout)
    release.make_release(checkout, "0.2.0", DAY, steps)

    assert steps.done == [("make", "check", "docs", "test-long"), (".ci/wheel_works",)]
    assert release.current_version(checkout) == "0.2.0"
    assert "version: 0.2.0\ndate-released: 2027-01-31\n" in (checkout / "CITATION.cff").read_text()
    assert "## 0.2.0 – 2027-01-31\n" in (checkout / "CHANGELOG.md").read_text()
    assert git(checkout, "tag").split() == ["v0.2.0"]
    assert git(checkout, "status", "--porcelain") == ""
    assert git(checkout, "show", "--stat", "--format=%s", "HEAD").startswith("Version 0.2.0")


def test_a_second_release_replaces_the_day_of_the_first(release, checkout):
    release.make_release(checkout, "0.2.0", DAY, Steps(checkout))
    changelog = checkout / "CHANGELOG.md"
    changelog.write_text(
        changelog.read_text().replace("## 0.2.0", "## 0.2.1 – unreleased\n\n- More.\n\n## 0.2.0")
    )
    git(checkout, "commit", "--quiet", "--all", "--message", "More")

    release.make_release(checkout, "0.2.1", date(2027, 2, 1), Steps(checkout))

    assert (checkout / "CITATION.cff").read_text().count("date-released") == 1
    assert "version: 0.2.1\ndate-released: 2027-02-01\n" in (checkout / "CITATION.cff").read_text()


@pytest.mark.parametrize("failing", ["make", ".ci/wheel_works"])
def test_a_step_that_fails_leaves_the_checkout_as_it_was(release, checkout, failing):
    before = git(checkout, "rev-parse", "HEAD")

    with pytest.raises(subprocess.CalledProcessError):
        release.make_release(checkout, "0.2.0", DAY, Steps(checkout, failing))
    assert git(checkout, "rev-parse", "HEAD") == before
    assert git(checkout, "status", "--porcelain") == ""
    assert git(checkout, "tag") == ""
    assert (checkout / "CHANGELOG.md").read_text() == CHANGELOG


@pytest.mark.parametrize(
    ("version", "problem"),
    [
        ("0.2", "three numbers such as 0.2.0"),
        ("-1.0.0", "three numbers such as 0.2.0"),
        ("0.0.9", "the package is at 0.1.0 already"),
        ("0.3.0", "begins with '0.2.0 – unreleased'; it must be '## 0.3.0 – unreleased'"),
    ],
)
def test_a_version_that_cannot_follow_is_refused_before_any_check(
    release, checkout, version, problem
):
    steps = Steps(checkout)
    with pytest.raises(release.ReleaseError, match=problem):
        release.make_release(checkout, version, DAY, steps)
    assert steps.done == []


def test_changes_that_are_not_committed_are_refused(release, checkout):
    (checkout / "CITATION.cff").write_text("version: 9\n")
    with pytest.raises(release.ReleaseError, match="not committed"):
        release.make_release(checkout, "0.2.0", DAY, Steps(checkout))


def test_a_version_is_released_once(release, checkout):
    git(checkout, "tag", "v0.2.0")
    with pytest.raises(release.ReleaseError, match=r"tag v0\.2\.0 already"):
        release.make_release(checkout, "0.2.0", DAY, Steps(checkout))


def test_an_empty_section_of_the_changelog_is_refused(release):
    empty = CHANGELOG.replace("- Something.\n", "")
    with pytest.raises(release.ReleaseError, match=r"says nothing of 0\.2\.0"):
        release.dated_changelog(empty, "0.2.0", DAY)
