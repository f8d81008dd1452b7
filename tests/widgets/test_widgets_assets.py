"""A widget's script is put together from its parts, and what cannot be put together is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from sfkit_widgets._assets import script, style

from sfkit.errors import InputError


def write(folder: Path, **files: str) -> None:
    """JavaScript files by stem."""
    for stem, text in files.items():
        (folder / f"{stem}.js").write_text(text, encoding="utf-8")


def test_parts_come_first_and_once(tmp_path: Path) -> None:
    write(
        tmp_path,
        leaf="export const ONE = 1;\n",
        left='import { ONE } from "./leaf.js";\nexport function left() {\n  return ONE;\n}\n',
        right='import {\n  ONE,\n} from "./leaf.js";\nexport async function right() {\n  return ONE;\n}\n',
        whole='import { left } from "./left.js";\nimport { right } from "./right.js";\n'
        "function render() {}\n\nexport default { render };\n",
    )
    text = script("whole.js", tmp_path)
    assert text.count("const ONE = 1;") == 1
    order = [text.index(word) for word in ("const ONE", "function left", "function right", "function render")]
    assert order == sorted(order)
    assert "import" not in text
    assert text.count("export") == 1
    assert text.endswith("export default { render };\n")


def test_shared_parts_are_found_from_anywhere(tmp_path: Path) -> None:
    write(tmp_path, whole='import { clamp } from "./_shared.js";\nconst one = clamp(3, 0, 1);\n')
    assert "function clamp(" in script("whole.js", tmp_path)


@pytest.mark.parametrize(
    "line",
    [
        'import * as all from "./leaf.js";',
        'import { ONE as one } from "./leaf.js";',
        'import { ONE } from "https://example.org/leaf.js";',
        'import "./leaf.js";',
        "export { left };",
        "export default left;",
    ],
)
def test_other_forms_are_refused(tmp_path: Path, line: str) -> None:
    write(tmp_path, leaf="export const ONE = 1;\n", whole=f"{line}\nfunction left() {{}}\n")
    with pytest.raises(InputError, match=r"whole.js: found"):
        script("whole.js", tmp_path)


def test_a_name_in_two_parts_is_refused(tmp_path: Path) -> None:
    write(
        tmp_path,
        leaf="export const ONE = 1;\n",
        whole='import { ONE } from "./leaf.js";\nfunction ONE() {}\n',
    )
    with pytest.raises(InputError, match=r"whole.js: declares 'ONE' as leaf.js does"):
        script("whole.js", tmp_path)


def test_a_missing_part_is_named(tmp_path: Path) -> None:
    write(tmp_path, whole='import { ONE } from "./gone.js";\n')
    with pytest.raises(InputError, match=r"gone.js: no such file"):
        script("whole.js", tmp_path)


def test_the_shared_style_comes_first(tmp_path: Path) -> None:
    (tmp_path / "own.css").write_text(".own {}\n", encoding="utf-8")
    text = style("own.css", folder=tmp_path)
    assert text.index("--sf-ink") < text.index(".own {}")
