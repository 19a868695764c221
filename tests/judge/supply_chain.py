#!/usr/bin/env python3
"""Lists the direct dependencies: where each comes from, its unsafe code, who audited it, why it is trusted.

    tests/judge/supply_chain.py [--audits FOLDER] [--write | --check]

FOLDER holds audit lists of cargo vet that others publish, as NAME.toml. The newest version up to the one in use is listed
to which audits lead: a complete one, then audits of differences. Lists also trust publishers, which cannot be judged
without the registry: those lists are in brackets. --write puts the table into the documentation, --check compares its crates and versions.
"""
from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

from python_env import ROOT
from tables import RESULTS, write_between

UNSAFE = re.compile(r"\bunsafe\s*(\{|fn\b|impl\b|extern\b|trait\b)")
#: The criteria of cargo vet itself, stricter one first.
CRITERIA = ("safe-to-deploy", "safe-to-run")


def direct_dependencies() -> list[dict]:
    """The packages from outside that crates of the workspace name, with their kinds of use in `uses`."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--all-features"]
    metadata = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout)
    packages = {package["id"]: package for package in metadata["packages"]}
    members, uses = set(metadata["workspace_members"]), {}
    for node in metadata["resolve"]["nodes"]:
        if node["id"] in members:
            for dependency in node["deps"]:
                if dependency["pkg"] not in members:
                    uses.setdefault(dependency["pkg"], set()).update(k["kind"] for k in dependency["dep_kinds"])
    found = [packages[identity] | {"uses": kinds} for identity, kinds in uses.items()]
    return sorted(found, key=lambda package: (package["name"], package["version"]))


def unsafe_blocks(package: dict) -> int:
    """Number of unsafe blocks, functions and impls in the package's source, without comments."""
    sources = (Path(package["manifest_path"]).parent / "src").rglob("*.rs")
    lines = (line.split("//")[0] for path in sources for line in path.read_text(errors="replace").splitlines())
    return sum(len(UNSAFE.findall(line)) for line in lines)


def meets(audit: dict, criterion: str) -> bool:
    stated = audit.get("criteria", [])
    stated = [stated] if isinstance(stated, str) else stated
    return any(c in stated for c in CRITERIA[: CRITERIA.index(criterion) + 1])


def number(version: str) -> tuple:
    """A version as numbers, for comparison; what is no release comes first."""
    parts = version.split("+")[0].split(".")
    return tuple(map(int, parts)) if all(part.isdigit() for part in parts) else ()


def audited(entries: list[dict], version: str, criterion: str) -> str | None:
    """The newest version up to `version` to which complete audits and audits of differences lead."""
    entries = [entry for entry in entries if meets(entry, criterion)]
    reached = {entry["version"] for entry in entries if "version" in entry}
    steps = [entry["delta"].split(" -> ") for entry in entries if " -> " in entry.get("delta", "")]
    for _ in steps:
        reached |= {new for old, new in steps if old in reached}
    older = [found for found in reached if () < number(found) <= number(version)]
    return max(older, key=number, default=None)


def published(lists: dict[str, dict], package: dict) -> tuple[bool, str]:
    """Whether a list covers this version; the newest covered versions, and in brackets lists that trust a publisher."""
    name, version, cells, trusting = package["name"], package["version"].split("+")[0], [], []
    for criterion in CRITERIA:
        found = {source: audited(audits.get("audits", {}).get(name, []), version, criterion) for source, audits in lists.items()}
        newest = max(filter(None, found.values()), key=number, default=None)
        if newest and f"{newest} " not in "".join(cells):
            sources = ", ".join(source for source, covered in found.items() if covered == newest)
            cells.append(f"{newest} {criterion}: {sources}")
    for source, audits in lists.items():
        if audits.get("wildcard-audits", {}).get(name) or audits.get("trusted", {}).get(name):
            trusting.append(source)
    exact = any(cell.startswith(f"{version} ") for cell in cells)
    return exact, "; ".join(cells + ([f"[{', '.join(trusting)}]"] if trusting else [])) or "–"


def vetted(name: str, version: str) -> dict | None:
    """The project's own audit or exemption of this version."""
    own = tomllib.loads((ROOT / "supply-chain/audits.toml").read_text()).get("audits", {}).get(name, [])
    exempt = tomllib.loads((ROOT / "supply-chain/config.toml").read_text()).get("exemptions", {}).get(name, [])
    return next((entry for entry in [*own, *exempt] if entry.get("version") == version), None)


def row(package: dict, lists: dict[str, dict]) -> str:
    entry = vetted(package["name"], package["version"])
    if entry is None or not entry.get("notes"):
        sys.exit(f"supply-chain: {package['name']} {package['version']} has no audit or exemption with notes")
    builds = any("custom-build" in target["kind"] for target in package["targets"])
    use = "program" if None in package["uses"] else "tests" if "dev" in package["uses"] else "build"
    cells = [package["name"], package["version"].split("+")[0], use, unsafe_blocks(package), "yes" if builds else "no",
             *([published(lists, package)[1]] if lists else []), entry["criteria"], entry["notes"]]
    return "| " + " | ".join(map(str, cells)) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--audits", type=Path, help="folder of published audit lists, NAME.toml")
    parser.add_argument("--write", action="store_true", help="put the table into the documentation")
    parser.add_argument("--check", action="store_true", help="fail if the documentation's table lacks one")
    args = parser.parse_args()
    files = sorted(args.audits.glob("*.toml")) if args.audits else []
    lists = {file.stem: tomllib.loads(file.read_text()) for file in files}
    packages = direct_dependencies()
    audits = ["published audits"] if lists else []
    heading = ["crate", "version", "used by", "unsafe", "build script", *audits, "criterion", "why it is trusted"]
    rows = ["| " + " | ".join(heading) + " |", "|" + "---|" * len(heading), *(row(p, lists) for p in packages)]
    text = f"{len(packages)} direct dependencies."
    if lists:
        answers = [published(lists, package) for package in packages]
        exact, trusted = sum(answer[0] for answer in answers), sum("[" in answer[1] for answer in answers)
        older = sum(answer[1][0].isdigit() for answer in answers) - exact
        text += (f" Published audits lead to exactly the version in use of {exact}, to an older one of {older}; a publisher of"
                 f" {trusted} is trusted. Lists: {', '.join(lists)}")
    text += ".\n\n" + "\n".join(rows)
    page = RESULTS / "supply-chain.md"
    if args.write:
        write_between(page, "dependencies", text)
    elif args.check:
        known, listed = page.read_text(), [" | ".join(line.split(" | ")[:2]) + " |" for line in rows[2:]]
        missing = [line for line in listed if line not in known]
        if missing:
            sys.exit(f"supply-chain: {page.name} lacks {missing[0]}; write it again: {Path(__file__).name} --write")
        exempted = sum(len(of) for of in tomllib.loads((ROOT / "supply-chain/config.toml").read_text())["exemptions"].values())
        if f"all {exempted} are exempted" not in known:
            sys.exit(f"supply-chain: {page.name} does not say that all {exempted} are exempted")
        print(f"{len(listed)} direct dependencies, each with a reason")
    else:
        print(text)


if __name__ == "__main__":
    main()
