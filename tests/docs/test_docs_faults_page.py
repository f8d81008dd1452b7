"""What docs/faults.md says holds a case is there."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_every_test_that_is_named_exists() -> None:
    text = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
    file, missing, seen = "", [], 0
    for named, test in re.findall(r"`([a-z_]+/test_\w+\.py)?(?:::(test_\w+))?`", text):
        file = named or file
        if not file:
            continue
        content = (ROOT / "tests" / file).read_text(encoding="utf-8")
        seen += bool(test)
        if test and f"def {test}(" not in content:
            missing.append(f"{file}::{test}")
    assert missing == []
    assert seen > 60
