"""Run sections of a report with their smallest settings, and read the tables that they write."""

from typer.testing import CliRunner

from benchmarks.__main__ import app


def written(folder, *sections):
    """Text of RESULTS.md after a quick run of the sections."""
    names = ",".join(sections)
    done = CliRunner().invoke(app, ["--quick", "--no-peer", "--out", str(folder), "--only", names])
    assert done.exit_code == 0, (done.output, done.exception)
    return (folder / "RESULTS.md").read_text()


def tables(text):
    """Every Markdown table of a text: a list of rows, each by its column's name."""
    found, header = [], None
    for line in text.splitlines():
        if not line.startswith("| "):
            header = None
        elif header is None:
            header = line.strip("| ").split(" | ")
            found.append([])
        elif not line.startswith("| ---"):
            found[-1].append(dict(zip(header, line.strip("| ").split(" | "), strict=True)))
    return found
