"""Documentation: relative links lead to a file, a heading or an item of code that exists; crates and version are those of Cargo."""

import functools
import re
import subprocess
import tomllib
from collections import Counter
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).resolve().parents[1]
FENCE = re.compile(r"^(```|~~~).*?^\1[^\S\n]*$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[(?P<label>(?:[^\[\]]|!\[[^\]]*\]\([^)]*\))*)\]\((?P<target>[^)\s]+)\)")
ITEM = re.compile(r"`(\w+(?:(?:::|\.)\w+)*)!?`")
HEADING = re.compile(r"^#+\s+(.*?)\s*#*$", re.MULTILINE)


def markdown_files() -> list[Path]:
    """Markdown files of the repository, without ignored ones."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.md"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return [ROOT / line for line in listed.stdout.splitlines() if (ROOT / line).is_file()]


@functools.cache
def anchors(path: Path) -> frozenset[str]:
    """Anchors of the headings of a Markdown file, as GitHub forms them."""
    count: Counter[str] = Counter()
    found = set()
    for heading in HEADING.findall(FENCE.sub("", path.read_text(encoding="utf-8"))):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
        found.add(f"{slug}-{count[slug]}" if count[slug] else slug)
        count[slug] += 1
    return frozenset(found)


def problem_of(path: Path, label: str, target: str) -> str | None:
    """The reason why a link of `path` is wrong; `None` if it is right or leads outside the repository."""
    if re.match(r"[a-z]+:", target):
        return None
    name, _, anchor = target.partition("#")
    place = (path.parent / unquote(name)).resolve() if name else path
    if not place.exists():
        return f"found no file {name}"
    if anchor and place.suffix == ".md" and anchor not in anchors(place):
        return f"found no heading #{anchor} in {place.relative_to(ROOT)}"
    item = ITEM.fullmatch(label)
    if item and item[1] != place.name and place.suffix in {".rs", ".py"}:
        words = set(re.findall(r"\w+", place.read_text(encoding="utf-8")))
        missing = [word for word in re.split(r"::|\.", item[1]) if word not in words]
        if missing:
            return f"found no {missing[0]} in {place.relative_to(ROOT)}"
    return None


@pytest.mark.parametrize("path", markdown_files(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_verif_relative_links_resolve(path: Path) -> None:
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    found = [(link, problem_of(path, link["label"], link["target"])) for link in LINK.finditer(text)]
    assert [f"[{link['label']}]({link['target']}): {problem}" for link, problem in found if problem] == []


@pytest.mark.parametrize(
    ("label", "target", "problem"),
    [
        ("`Sweep`", "nowhere.rs", "found no file nowhere.rs"),
        ("heading", "../README.md#no-such-heading", "found no heading #no-such-heading in README.md"),
        ("`Sidecar.no_such_key`", "../sim/whisker_sim/trace.py", "found no no_such_key in sim/whisker_sim/trace.py"),
        ("`Sidecar.rows`", "../sim/whisker_sim/trace.py", None),
        ("`trace.py`", "../sim/whisker_sim/trace.py", None),
        ("outside", "https://example.org/nowhere", None),
    ],
)
def test_robust_wrong_links_are_named(label: str, target: str, problem: str | None) -> None:
    assert problem_of(ROOT / "docs" / "PHYSICS.md", label, target) == problem


def test_verif_citation_names_the_version_of_the_workspace() -> None:
    cited = re.search(r'^version: "(.*)"$', (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    built = re.search(r'^version = "(.*)"$', (ROOT / "Cargo.toml").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited
    assert built
    assert cited[1] == built[1]


def test_verif_architecture_lists_the_dependencies_of_every_crate() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `crates/([\w-]+)` \|[^|]*\|([^|]*)\|", text, re.MULTILINE)
    listed = {name: sorted(re.findall(r"`([\w-]+)`", cell)) for name, cell in rows}
    manifests = {path.parent.name: tomllib.loads(path.read_text(encoding="utf-8")) for path in ROOT.glob("crates/*/Cargo.toml")}
    built = {name: sorted(manifests.keys() & manifest.get("dependencies", {})) for name, manifest in manifests.items()}
    assert listed == built
