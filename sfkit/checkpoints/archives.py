"""What torch files hold, told without torch: an archive since torch 1.6, a row of pickles before.

Both describe their content in pickle's instructions. These are parsed here, not run: they build dictionaries,
lists, numbers, texts and tensors' places, and call nothing but the functions below. Whatever else a file has
(objects of other classes, views that are not contiguous, another byte order, a cut end) is left to torch.
A file may be hostile: what it says is bounded before anything is computed from it.
"""

from __future__ import annotations

import mmap
import pickle
import struct
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import IO, Any

_STORAGES = {  # type and bytes of an element
    "torch DoubleStorage": ("torch.float64", 8),
    "torch FloatStorage": ("torch.float32", 4),
    "torch HalfStorage": ("torch.float16", 2),
    "torch BFloat16Storage": ("torch.bfloat16", 2),
    "torch LongStorage": ("torch.int64", 8),
    "torch IntStorage": ("torch.int32", 4),
    "torch ShortStorage": ("torch.int16", 2),
    "torch CharStorage": ("torch.int8", 1),
    "torch ByteStorage": ("torch.uint8", 1),
    "torch BoolStorage": ("torch.bool", 1),
}
_MAGIC, _PROTOCOL = 0x1950A86A20F9469CFC6C, 1001  # with which a row of pickles begins
_NUMBERS = {  # instruction -> how the number behind it is written
    code: form
    for form, codes in (
        ("<B", (pickle.BINPUT, pickle.BINGET, pickle.BININT1, pickle.PROTO)),
        ("<H", (pickle.BININT2,)),
        ("<I", (pickle.LONG_BINPUT, pickle.LONG_BINGET)),
        ("<i", (pickle.BININT,)),
        (">d", (pickle.BINFLOAT,)),
    )
    for code in codes
}
_TEXTS = {pickle.LONG1: 1, pickle.BINUNICODE: 4}  # bytes of the length before them
_PLAIN: dict[bytes, Callable[[], Any]] = {
    pickle.NONE: lambda: None,
    pickle.NEWTRUE: lambda: True,
    pickle.NEWFALSE: lambda: False,
    pickle.EMPTY_DICT: dict,
    pickle.EMPTY_LIST: list,
    pickle.EMPTY_TUPLE: tuple,
}
_TUPLES = {pickle.TUPLE1: 1, pickle.TUPLE2: 2, pickle.TUPLE3: 3}
_DIMENSIONS, _LARGEST = 64, 1 << 63  # of a tensor: more and larger numbers are no tensor's
# What parsing bytes can come to that are no such file.
_UNREADABLE = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, MemoryError, OSError, RuntimeError),
    *(TypeError, ValueError, struct.error),
    zipfile.BadZipFile,
)


@dataclass(frozen=True)
class StoredPiece:
    """A tensor as the pickle describes it: so many elements of a storage.

    Attributes:
        storage: its name in the file.
        dtype: as torch spells it.
        width: bytes of one element.
        shape: of the tensor.
        offset: elements of the storage before it.
    """

    storage: str
    dtype: str
    width: int
    shape: tuple[int, ...]
    offset: int


@dataclass(frozen=True)
class TorchContent:
    """A torch file's content.

    Attributes:
        value: what was saved, with a :class:`StoredPiece` for each tensor.
        storages: name -> its first byte in the file, and the one behind its last.
    """

    value: object
    storages: Mapping[str, tuple[int, int]]

    def extent(self, piece: StoredPiece) -> tuple[int, int] | None:
        """The first byte of a tensor and the one behind its last; None if that is not all there."""
        if piece.storage not in self.storages:
            return None
        first, behind = self.storages[piece.storage]
        begin = first + piece.offset * piece.width
        end = begin + prod(piece.shape) * piece.width
        return (begin, end) if end <= behind else None


def torch_content(path: Path) -> TorchContent | None:
    """The content of a torch file in which nothing is unusual; None for others: torch says why."""
    try:
        if zipfile.is_zipfile(path):
            return _archive(path)
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as pages:
            return _row(pages)
    except _UNREADABLE:
        return None


def _archive(path: Path) -> TorchContent | None:
    with zipfile.ZipFile(path) as archive, path.open("rb") as file:
        # Everything lies below one folder, whose name is of no matter.
        entries = {entry.filename.partition("/")[2]: entry for entry in archive.infolist()}
        # Nothing is inflated: a small file could hold gigabytes.
        stored = all(
            entry.compress_type == zipfile.ZIP_STORED and entry.compress_size == entry.file_size
            for entry in entries.values()
        )
        # Of two entries by one name readers take either.
        if not stored or len(entries) != len(archive.infolist()):
            return None
        if "byteorder" in entries and archive.read(entries["byteorder"]) != b"little":
            return None
        pickled = archive.read(entries["data.pkl"])
        storages = {
            name.removeprefix("data/"): _extent(file, entry)
            for name, entry in entries.items()
            if name.startswith("data/")
        }
    if any(behind > path.stat().st_size for _, behind in storages.values()):
        return None
    return TorchContent(_Instructions(pickled).follow(), storages)


def _extent(file: IO[bytes], entry: zipfile.ZipInfo) -> tuple[int, int]:
    """Where an entry's content is: behind a header of its own, whose length the directory does not say."""
    file.seek(entry.header_offset)
    # A local header is 30 bytes, with the lengths of a name and of further fields at 26 and 28.
    header = file.read(30)
    if header[:4] != b"PK\3\4":
        raise ValueError("no entry")
    lengths = (int.from_bytes(header[at : at + 2], "little") for at in (26, 28))
    begin = entry.header_offset + 30 + sum(lengths)
    return begin, begin + entry.file_size


def _row(pages: mmap.mmap) -> TorchContent | None:
    program = _Instructions(pages)
    if program.follow() != _MAGIC or program.follow() != _PROTOCOL:
        return None
    system, value, names = (program.follow() for _ in range(3))
    if system["little_endian"] is not True:
        return None
    storages, at = {}, program.at
    for name in names:
        _into(name, str)
        begin = at + 8  # behind the number of elements
        at = begin + int.from_bytes(pages[at:begin], "little") * program.widths[name]
        storages[name] = (begin, at)
    return TorchContent(value, storages) if at <= len(pages) else None


class _Instructions:
    """Pickle's instructions as torch writes them, followed one by one.

    Attributes:
        data: the instructions.
        at: the byte of them that comes next.
        widths: storage -> bytes of one of its elements.
    """

    def __init__(self, data: bytes | mmap.mmap) -> None:
        self.data, self.at = data, 0
        self.widths: dict[str, int] = {}

    def follow(self) -> Any:
        """What is described up to the next end; KeyError for what is not known here."""
        stack: list[Any] = []
        marks: list[int] = []
        memo: dict[int, Any] = {}

        def cut() -> list[Any]:
            """What stands above the last mark."""
            above = stack[(mark := marks.pop()) :]
            del stack[mark:]
            return above

        while (code := self._bytes(1)) != pickle.STOP:
            if code in _NUMBERS:
                (value,) = struct.unpack(_NUMBERS[code], self._bytes(struct.calcsize(_NUMBERS[code])))
                if code in (pickle.BINPUT, pickle.LONG_BINPUT):
                    memo[value] = stack[-1]
                elif code != pickle.PROTO:
                    stack.append(memo[value] if code in (pickle.BINGET, pickle.LONG_BINGET) else value)
            elif code in _TEXTS:
                length = int.from_bytes(self._bytes(_TEXTS[code]), "little")
                content = self._bytes(length)
                number = code == pickle.LONG1
                stack.append(int.from_bytes(content, "little", signed=True) if number else content.decode())
            elif code in _PLAIN:
                stack.append(_PLAIN[code]())
            elif code == pickle.MARK:
                marks.append(len(stack))
            elif code == pickle.TUPLE:
                stack.append(tuple(cut()))
            elif code in _TUPLES:
                stack[-_TUPLES[code] :] = [tuple(stack[-_TUPLES[code] :])]
            elif code in (pickle.SETITEM, pickle.SETITEMS):
                items = cut() if code == pickle.SETITEMS else [stack.pop(-2), stack.pop()]
                # Only these: to hash a deep tuple takes the whole stack, or forever.
                if not all(type(key) in (str, int) for key in items[::2]):
                    raise TypeError("no key of a state dict or an optimiser's state")
                _into(stack[-1], dict).update(zip(items[::2], items[1::2], strict=True))
            elif code in (pickle.APPEND, pickle.APPENDS):
                items = cut() if code == pickle.APPENDS else [stack.pop()]
                _into(stack[-1], list).extend(items)
            elif code == pickle.GLOBAL:
                stack.append(_Name(f"{self._line()} {self._line()}"))
            elif code == pickle.BINPERSID:
                stack.append(self._storage(*stack.pop()))
            elif code == pickle.REDUCE:
                given = stack.pop()
                stack.append(_CALLED[_into(stack.pop(), _Name).text](*given))
            elif code == pickle.BUILD:  # the versions of modules, which a state dict carries
                stack.pop()
                _into(stack[-1], OrderedDict)
            else:
                raise KeyError(code)
        return stack.pop()

    def _bytes(self, count: int) -> bytes:
        self.at += count
        if self.at > len(self.data):
            raise ValueError("no end")
        return self.data[self.at - count : self.at]

    def _line(self) -> str:
        begin, end = self.at, self.data.find(b"\n", self.at)
        self.at = end + 1
        return self.data[begin:end].decode() if end >= 0 else ""

    def _storage(self, kind: str, of: _Name, name: str, _: str, count: int, view: None = None) -> _Storage:
        dtype, width = _STORAGES[_into(of, _Name).text]
        if kind != "storage" or view is not None or type(count) is not int:
            raise ValueError("no plain storage")
        if self.widths.setdefault(_into(name, str), width) != width:
            raise ValueError("one storage of two types")
        return _Storage(name, dtype, width, count)


@dataclass(frozen=True)
class _Name:
    """A class or function, as the file names it; KeyError for others than torch writes of plain tensors."""

    text: str

    def __post_init__(self) -> None:
        if self.text not in _CALLED and self.text not in _STORAGES:
            raise KeyError(self.text)


@dataclass(frozen=True)
class _Storage:
    name: str
    dtype: str
    width: int
    count: int


def _into(value: Any, kind: type[Any]) -> Any:
    """The value, of the type it must have."""
    if not isinstance(value, kind):
        raise TypeError(f"{type(value)} in place of {kind}")
    return value


def _tensor(storage: _Storage, offset: int, shape: Any, stride: Any, _: bool, __: object) -> StoredPiece:
    numbers = (offset, *_into(shape, tuple), *_into(stride, tuple))
    if len(shape) > _DIMENSIONS or not all(type(n) is int and 0 <= n < _LARGEST for n in numbers):
        raise ValueError("no shape of a tensor")
    elements = 1
    # From the last dimension on, whose step is 1 where nothing lies between elements.
    for length, step in zip(reversed(shape), reversed(stride), strict=True):
        # A dimension of one entry may have any step.
        if length > 1 and step != elements:
            raise ValueError("no contiguous tensor")
        elements *= length
    if offset + elements > _into(storage, _Storage).count:
        raise ValueError("no such part of the storage")
    return StoredPiece(storage.name, storage.dtype, storage.width, shape, offset)


def _parameter(piece: StoredPiece, _: bool, __: object) -> StoredPiece:
    found: StoredPiece = _into(piece, StoredPiece)
    return found


_CALLED: dict[str, Callable[..., object]] = {
    "collections OrderedDict": lambda: OrderedDict(),  # as it is written; arguments would be copied
    "torch._utils _rebuild_tensor_v2": _tensor,
    "torch._utils _rebuild_parameter": _parameter,
}
