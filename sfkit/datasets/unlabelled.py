"""Stereo pairs without ground truth, as cameras and public data sets leave them.

| layout | left | right |
|---|---|---|
| two folders | ``left/NAME`` | ``right/NAME``, matched by name, or by number where no name is in both |
| KITTI raw | ``.../image_02/data/N.png`` (else ``image_00``) | ``.../image_03/data/N.png`` (``image_01``) |
| KITTI 2012, 2015 | ``image_2/NAME`` (else ``colored_0``, ``image_0``) | ``image_3/NAME`` (and so on) |
| one folder | ``im0``, ``im2``, ``view1``, ``left``, ``NAME_left`` | ``im1``, ``im6``, ``view5``, ... |
| CSV | column ``left`` | column ``right``; a column ``id`` may be added |

Folders are looked through four levels deep.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePath

from sfkit.datasets.folders import CONVENTIONS, IMAGES
from sfkit.datasets.listing import PairListing
from sfkit.datasets.matching import ensure_two, match_by_number
from sfkit.datasets.pairs import StereoPair
from sfkit.datasets.root_folder import inside, open_root
from sfkit.errors import InputError
from sfkit.files import home, is_file, trouble
from sfkit.settings import require_whole

DEPTH = 4
FOLDERS = (
    ("left", "right"),
    ("image_02/data", "image_03/data"),
    ("image_00/data", "image_01/data"),
    ("image_2", "image_3"),
    ("colored_0", "colored_1"),
    ("image_0", "image_1"),
)
"""Left and right folders of images; of one parent, the first of these that is there counts (colour first)."""


def find_unlabelled(
    root: Path | str, table: Path | str | None = None, every: int = 1
) -> tuple[Path, PairListing]:
    """The root, and the pairs under it or in a CSV file (``table``, or ``root`` itself).

    Args:
        root: the folder; also a CSV file, whose paths are then relative to its folder.
        table: a CSV file that lies elsewhere.
        every: of each folder of images (a video), every so many pairs are kept, the first among them.

    Raises:
        InputError: nothing is there, folders of different length, a frame on one side only, or a table
            that cannot be read.
    """
    require_whole("every", every, 1)
    root = home(root)
    if table is None and root.is_file():
        table, root = root, root.parent
    folder = open_root(root)
    pairs = _in_table(home(table), folder)[::every] if table is not None else _in_folders(folder, every)
    if not pairs:
        names = ", ".join(f"{left}/{right}" for left, right, _ in CONVENTIONS)
        raise InputError(
            f"{folder}: found no stereo pair, expected folders left and right (or image_02/data and "
            f"image_03/data), files {names} or *_left/*_right, or a CSV with the columns left, right"
        )
    ids = [pair.id for pair in pairs]
    if twice := sorted({name for name in ids if ids.count(name) > 1}):
        raise InputError(
            f"{folder}: found the pair {twice[0]!r} twice, expected one of each name: rename one, or list "
            "the pairs in a CSV with a column id"
        )
    return folder, PairListing(tuple(sorted(pairs, key=lambda pair: pair.id)))


def _in_folders(root: Path, every: int) -> list[StereoPair]:
    pairs: list[StereoPair] = []
    for folder in _walk(root, DEPTH):
        sides = next(((folder / a, folder / b) for a, b in FOLDERS if (folder / a).is_dir()), None)
        if sides is not None:
            pairs += _matched(root, *sides)[::every]
            continue
        pairs += _in_one(root, folder)
    return pairs


def _walk(folder: Path, depth: int) -> Iterable[Path]:
    """A folder and those below it; not those whose images belong to their parent."""
    yield folder
    taken = {name.partition("/")[0] for sides in FOLDERS for name in sides}
    if depth:
        for below in sorted(folder.iterdir()):
            if below.is_dir() and not below.name.startswith(".") and below.name not in taken:
                yield from _walk(below, depth - 1)


def _images(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGES and path.is_file())


def _matched(root: Path, left: Path, right: Path) -> list[StereoPair]:
    """The pairs of two folders, by name, or by number where no name is in both."""
    ensure_two(left, right)
    if not right.is_dir():
        raise InputError(f"{left}: found no folder {right.name} beside it, expected the right images there")
    lefts, rights = _images(left), _images(right)
    theirs, ours = {path.name: path for path in rights}, {path.name for path in lefts}
    shared = [path for path in lefts if path.name in theirs]
    if not shared and len(lefts) != len(rights):
        raise InputError(
            f"{left} and {right}: found {len(lefts)} and {len(rights)} images without a name in common, "
            "expected as many left as right: were frames dropped? List the pairs in a CSV"
        )
    alone = [path for path in lefts if path.name not in theirs] + [p for p in rights if p.name not in ours]
    if shared and alone:
        raise InputError(
            f"{alone[0]}: found no image of that name on the other side ({len(alone)} such in all), expected "
            "each frame in both folders: were frames dropped? Move these away, or list the pairs in a CSV"
        )
    couples = [(a, theirs[a.name]) for a in shared]
    if not shared and lefts:
        couples = match_by_number(lefts, rights)
    named = _prefix(root, left)
    return [_pair(root, f"{named}{a.stem}", a, b) for a, b in couples]


def _prefix(root: Path, left: Path) -> str:
    """What tells the frames of one folder from those of another, such as ``drive_0001/``."""
    depth = next(a.count("/") + 1 for a, _ in FOLDERS if left.as_posix().endswith(f"/{a}"))
    parent = left.parents[depth - 1].relative_to(root).as_posix()
    return "" if parent == "." else f"{parent}/"


def _in_one(root: Path, folder: Path) -> list[StereoPair]:
    """The pairs whose two images lie in one folder, by names in common use."""
    by_stem: dict[str, Path] = {}
    for path in _images(folder):
        if path.stem in by_stem:
            raise InputError(
                f"{folder}: found {by_stem[path.stem].name} and {path.name}, expected one of them"
            )
        by_stem[path.stem] = path
    place = folder.relative_to(root).as_posix()
    own = [(a, b, folder.name if place == "." else place) for a, b, _ in CONVENTIONS]
    prefix = "" if place == "." else f"{place}/"
    ended = (stem.removesuffix("_left") for stem in by_stem if stem.endswith("_left"))
    # The left view's disparity, such as NAME_disp_left, is no image.
    ended = (stem for stem in ended if stem.rpartition("_")[2] not in ("disp", "disparity"))
    own += [(f"{stem}_left", f"{stem}_right", f"{prefix}{stem}") for stem in ended]
    pairs = []
    for a, b, name in own:
        if a in by_stem and b not in by_stem:
            raise InputError(f"{by_stem[a]}: found no {b} beside it, expected the right image of the pair")
        if a in by_stem:
            pairs.append(_pair(root, name, by_stem[a], by_stem[b]))
    return pairs


def _in_table(table: Path, root: Path) -> list[StereoPair]:
    pairs = []
    for line, row in enumerate(_rows(table), start=2):
        left, right = (inside(root, row[side]) for side in ("left", "right"))
        for path in (left, right):
            if not is_file(path):
                raise InputError(f"{table}, line {line}: found no {path}, expected every image under {root}")
        ensure_two(left, right)
        name = row.get("id") or PurePath(row["left"]).with_suffix("").as_posix()
        pairs.append(StereoPair(name, left, right, None))
    return pairs


def _rows(table: Path) -> Sequence[dict[str, str]]:
    if why := trouble(table):
        raise InputError(f"{table}: cannot be read ({why}), expected a CSV file")
    try:
        # Spreadsheets may begin a file with a byte order mark, which would belong to the first column's name.
        with table.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream, strict=True)
            if not {"left", "right"} <= set(reader.fieldnames or ()):
                raise InputError(
                    f"{table}: found the columns {list(reader.fieldnames or ())}, expected left and right"
                )
            rows = [{key: (value or "").strip() for key, value in row.items() if key} for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{table}: cannot be read as a CSV file ({error}), expected left,right rows"
        ) from error
    for line, row in enumerate(rows, start=2):
        if not (row["left"] and row["right"]):
            raise InputError(f"{table}, line {line}: left or right is empty, expected a path in each")
    return rows


def _pair(root: Path, name: str, left: Path, right: Path) -> StereoPair:
    return StereoPair(name, inside(root, left), inside(root, right), None)
