"""Documentation: links lead to what exists; crates and version are those of Cargo; measured values are those of the tables."""

import functools
import re
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path
from urllib.parse import unquote

import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "docs"))

import figures

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


@pytest.mark.parametrize("name", figures.DOCUMENTS)
def test_verif_measured_values_are_those_of_the_results_tables(name: str) -> None:
    assert figures.problems(name, (ROOT / name).read_text(encoding="utf-8")) == []


def test_verif_each_measured_value_is_shown_and_has_a_commit() -> None:
    shown = "".join((ROOT / name).read_text(encoding="utf-8") for name in figures.DOCUMENTS)
    rows = [key for key in figures.values("measured") if "/" not in key]
    assert [row for row in rows if not re.search(rf"measured\.{re.escape(row)}[ /]", shown)] == []
    assert [row for row in rows if not re.fullmatch("[0-9a-f]{7}", figures.values("measured")[f"{row}/commit"])] == []


@pytest.fixture
def tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of results tables with two claims, of which one does not hold, and one run."""
    claims = ["id,claim,measured,relation,bound,unit,holds", "mean,mean error,0.0701,<=,0.1,mm,true"]
    claims.append("worst,largest error,12.3,<=,10,mm,false")
    (tmp_path / "claims.csv").write_text("\n".join(claims), encoding="utf-8")
    (tmp_path / "standard").mkdir()
    summary = ["group,whisker,estimator,noise,rmse_m", "pin,straight,ekf,0.01,0.000049", "pin,straight,ukf,0.01,0.00006"]
    (tmp_path / "standard" / "summary.csv").write_text("\n".join(summary), encoding="utf-8")
    (tmp_path / "standard" / "run.json").write_text('{"watermark": {"git_commit": "0123456789"}}', encoding="utf-8")
    monkeypatch.setattr(figures, "REFERENCE", tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("claims.mean .2f", "0.07"),
        ("claims.mean .0f", "< 1"),
        ("claims.mean/bound", "0.1"),
        ("max claims.* .1f", "12.3"),
        ("p5 claims.* .2f", "0.07"),
        ("p95 claims.* .1f", "12.3"),
        ("sum claims.* .1f", "12.4"),
        ("count claims.*", "2"),
        ("summary.standard/pin/straight/ekf/0.01/rmse_m .3f mm or-none", "0.049"),
        ("summary.standard/pin/straight/ekf/0.01/nees .2f or-none", "none"),
        ("unmet_count", "1"),
        ("summary.standard/pin/straight/ekf/0.01/rmse_m .3f mm", "0.049"),
        ("max summary.standard/*/*/u*/0..0.05/rmse_m .0e", "6e-5"),
        ("commit.standard", "0123456"),
    ],
)
@pytest.mark.usefixtures("tables")
def test_verif_a_source_gives_the_value_of_the_table(source: str, text: str) -> None:
    assert figures.figure(source) == text
    assert figures.written(f"a <!--= {source} -->1 mm<!--/--> b") == f"a <!--= {source} -->{text}<!--/--> b"


@pytest.mark.usefixtures("tables")
def test_verif_claims_that_do_not_hold_form_a_table() -> None:
    assert figures.figure("unmet_claims").splitlines()[-1] == "| largest error | 12.3 | <= 10 | mm |"


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("claims.median .2f", "`claims.median .2f`: found 0 values, expected 1"),
        ("claims.* .2f", "`claims.* .2f`: found 2 values, expected 1"),
        ("claims.median/bound .2f or-none", "`claims.median/bound .2f or-none`: found no row, expected 1"),
        ("results.mean .2f", "found table `results`, expected one of claims"),
        ("claims.mean .2q", "`claims.mean .2q`: "),
        ("claims.mean .2f inch", "`claims.mean .2f inch`: "),
    ],
)
@pytest.mark.usefixtures("tables")
def test_robust_a_wrong_source_is_named(source: str, message: str) -> None:
    with pytest.raises(figures.FigureError, match=re.escape(message)):
        figures.figure(source)


@pytest.mark.usefixtures("tables")
def test_robust_stale_and_unmarked_values_are_found() -> None:
    text = """
Noise 1 %. <!-- given: 1 % --> The error is 0.07 mm, at most <!--= claims.worst .1f -->15.7<!--/--> mm, as `5 mm`.

| quantity | measured | bound |
| --- | --- | --- |
| radius 3 mm | 0.05 | 0.1 |

# Settings
<!-- given: all -->
Length 80 mm.

Mean
<!--= claims.mean .2f -->0.07<!--/--> mm.
"""
    assert figures.problems("A.md", text) == [
        "A.md: `claims.worst .1f`: found '15.7', expected '12.3'",
        "A.md: `claims.mean .2f`: a line begins with this mark, which ends the paragraph",
        "A.md: found 0.07 mm, expected a mark or a `given` comment",
        "A.md: found 3 mm, expected a mark or a `given` comment",
        "A.md: found 0.05, expected a mark or a `given` comment",
    ]
