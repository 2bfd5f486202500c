"""What mkdocs does beside rendering pages: equations to MathML, and pages of benchmarks from their JSON results."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks" / "results"
_MOST_COLUMNS, _MOST_ROWS = 9, 60
_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_DISPLAY = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)

_PRIME = re.compile(r"<msup>(<mi>[^<]*</mi>)<mi>&#x02032;</mi></msup>")
"""The glyph of a prime is raised already; as an exponent it flies away."""


def on_page_content(text: str, **_: Any) -> str:
    """MathML needs no script, and no request to anyone: every browser draws it."""
    text = _INLINE.sub(lambda found: convert(html.unescape(found[1])), text)
    text = _DISPLAY.sub(lambda found: convert(html.unescape(found[1].strip()), display="block"), text)
    return _PRIME.sub(r"<mrow>\1<mo>&#x02032;</mo></mrow>", text)


def on_files(files: Files, config: Any) -> Files:
    """A page for each result, and one that lists them."""
    lines = [
        "# Benchmarks",
        "",
        "Made from `benchmarks/results/*.json` as they were measured; each names its script.",
        "",
    ]
    for path in sorted(RESULTS.glob("*.json")):
        figure = path.with_suffix(".png")
        title = path.stem.replace("_", " ").replace("-", " ").capitalize()
        lines.append(f"- [{title}]({path.stem}.md)")
        files.append(
            File.generated(config, f"benchmarks/{path.stem}.md", content=_page(title, path, figure.exists()))
        )
        for extra in (path, figure):
            if extra.exists():
                files.append(File.generated(config, f"benchmarks/{extra.name}", abs_src_path=str(extra)))
    files.append(File.generated(config, "benchmarks/index.md", content="\n".join(lines)))
    return files


def _page(title: str, path: Path, has_figure: bool) -> str:
    parts = [f"# {title}", ""]
    if has_figure:
        parts += [f"![{title}]({path.stem}.png)", ""]
    data = json.loads(path.read_text("utf-8"))
    for heading, rows in _tables(data, ""):
        parts += [f"## {heading}", ""] if heading else []
        parts += [_table(rows), ""]
    parts += [f"[All numbers]({path.name})", ""]
    return "\n".join(parts)


def _tables(data: Any, heading: str) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """What can be shown as rows: lists of mappings, mappings of mappings (a table for each name
    where those hold nothing but mappings), and what is left as one row a name."""
    if isinstance(data, list) and data and all(isinstance(row, dict) for row in data):
        yield heading, [_flat(row) for row in data]
    elif isinstance(data, dict):
        inner = {key: value for key, value in data.items() if isinstance(value, dict)}
        deeper = all(isinstance(item, dict) for value in inner.values() for item in value.values())
        if len(inner) > 1 and len(inner) == len(data) and not deeper:
            yield heading, [{"": key, **_flat(value)} for key, value in inner.items()]
            return
        plain = _flat({key: value for key, value in data.items() if not isinstance(value, (dict, list))})
        if plain:
            yield heading, [{"": key, "value": value} for key, value in plain.items()]
        for key, value in data.items():
            if isinstance(value, (dict, list)):
                yield from _tables(value, f"{heading}, {key}" if heading else key.replace("_", " ").capitalize())


def _flat(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Numbers and words by dotted name; lists are left to the file itself."""
    found: dict[str, Any] = {}
    for key, value in row.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{prefix}{key}.")
        elif not isinstance(value, list):
            found[f"{prefix}{key}"] = value
    return found


def _table(rows: list[dict[str, Any]]) -> str:
    columns = list(dict.fromkeys(key for row in rows for key in row))[:_MOST_COLUMNS]
    lines = ["| " + " | ".join(column.replace("_", " ") for column in columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(_cell(row.get(column)) for column in columns) + " |" for row in rows[:_MOST_ROWS]]
    return "\n".join(lines)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:.4g}" if isinstance(value, float) else f"{value}"
    return text[:80].replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")
