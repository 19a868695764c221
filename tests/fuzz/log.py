"""What fuzz targets have done, over all runs: executions, memory, coverage."""
import datetime
import json
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
PAGE = ROOT / "docs/src/results/fuzzing.md"
sys.path.insert(0, str(ROOT / "tests/judge"))
from tables import write_between


def number(pattern, text):
    """The last number of the output that follows the pattern; 0 if there is none."""
    found = re.findall(pattern + r"\s*(\d+)", text)
    return int(found[-1]) if found else 0


def add(path, name, output, seconds):
    """Adds a run to the log."""
    log = json.loads(path.read_text()) if path.exists() else {}
    today = datetime.date.today().isoformat()
    entry = log.setdefault(name, {"executions": 0, "seconds": 0, "runs": 0, "peak_mb": 0, "edges": 0, "features": 0, "from": today})
    entry["executions"] += number(r"stat::number_of_executed_units:", output)
    entry["seconds"] += seconds
    entry["runs"] += 1
    entry["peak_mb"] = max(entry["peak_mb"], number(r"stat::peak_rss_mb:", output))
    entry["edges"] = max(entry["edges"], number(r"cov:", output))
    entry["features"] = max(entry["features"], number(r"ft:", output))
    entry["until"] = today
    counters = re.search(r"Loaded \d+ modules\s+\((\d+) inline", output)
    entry["counters"] = int(counters.group(1)) if counters else 0
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(log, indent=1) + "\n")
    print(f"{name}: {entry['executions']:,} executions in all, {entry['edges']} edges, {entry['peak_mb']} MB", flush=True)


def write(path, names, corpora):
    """Puts the log into the documentation."""
    log = json.loads(path.read_text())
    lines = ["| target | executions | hours | largest memory, MB | edges covered | features | inputs kept |",
             "|---|---|---|---|---|---|---|"]
    for name in names:
        entry = log.get(name)
        if entry is None:
            lines.append(f"| {name} | none |" + " – |" * 5)
            continue
        kept = [file for file in (corpora / name).iterdir()]
        size = sum(file.stat().st_size for file in kept) / 1000
        share = f"{entry['edges']} of {entry['counters']}"
        cells = [name, f"{entry['executions']:,}", f"{entry['seconds'] / 3600:.2f}", entry["peak_mb"], share,
                 entry["features"], f"{len(kept)}, {size:.0f} kB"]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    dates = {entry[key] for entry in log.values() for key in ("from", "until")}
    total = sum(entry["executions"] for entry in log.values())
    lines[:0] = [f"{min(dates)} to {max(dates)}: {total:,} executions." if len(dates) > 1 else f"{max(dates)}: {total:,} executions.", ""]
    write_between(PAGE, "fuzzing", "\n".join(lines))
