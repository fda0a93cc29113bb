"""Damaged files of every reader, made from small valid ones, and what comes of them."""

from __future__ import annotations

import re
import struct
import time
import warnings
from collections import Counter
from functools import cache
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import xarray as xr
from scipy.io import savemat, wavfile

import data_synth
import hums
from attacks.odd_calls import bounded
from hums.fleet.watched_machines import read_state
from hums.readers.process import ReaderProcess
from hums.records.store import write_tree

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

COUNT = 400  # samples of a file: small ones have most of their bytes in headers
CPU_S = 5.0
MEMORY_BYTES = 1 << 30
LONGEST_MESSAGE = 1000
SIZES = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
NOISE = np.random.default_rng(20).normal(size=COUNT)
DECLARED: dict[str, Any] = {"units": "g", "rate_hz": 1000.0, "no_tachometer": True}
SCENE = """\
gearbox = "two-stage"
rate_hz = 2000
duration_s = 1.5
fidelity = "kinematic"
speed = { link = "input", rpm = [[0, 600], [1, 620]] }
tachometer = { link = "input", pulses_per_rev = 1 }
resonance = { frequency_hz = 500, damping_ratio = 0.05 }
sensor = [{ name = "vib", on = "output", units = "g" }]
"""
LVM = """\
LabVIEW Measurement\t
Separator\tTab
X_Columns\tOne
Decimal_Separator\t.
***End_of_Header***\t
Channels\t1
Samples\t400
Y_Unit_Label\tg
X_Dimension\tTime
X0\t0.0
Delta_X\t0.001
***End_of_Header***\t
X_Value\tvib\tComment
"""
WORK = "date,component,work\n2026-03-01,input bearing,replaced\n2026-04-02T10:00:00Z,gear 2,oil\n"

FOREIGN = ("csv", "wav", "mat v5", "mat v5, packed", "mat v7.3", "hdf5", "tdms", "lvm", "mf4", "uff", "npy", "npz")
STORED = ("record", "analysis")  # by us, read in the process for readers
TEXTS: Mapping[str, Callable[[Path], object]] = {  # read in the calling process, by code of ours and of Python
    "gearbox": lambda path: hums.defect_orders(hums.load_gearbox(path)),
    "scene": data_synth.load_scene,
    "maintenance": hums.read_maintenance,
    "state": read_state,
}
KINDS = (*FOREIGN, *STORED, *TEXTS)
CHANNELS = {"wav": "channel 1", "mat v5, packed": "box.vib", "tdms": "group.vib", "uff": "1", "npy": "column 1"}
SUFFIXES = {
    "csv": ".csv", "wav": ".wav", "mat v5": ".mat", "mat v5, packed": ".mat", "mat v7.3": ".mat", "tdms": ".tdms",
    "lvm": ".lvm", "mf4": ".mf4",
    "uff": ".uff", "npy": ".npy", "npz": ".npz", "gearbox": ".toml", "scene": ".toml", "maintenance": ".csv",
    "state": ".state",
}  # fmt: skip


def write_valid(kind: str, path: Path) -> None:  # noqa: C901, PLR0912 - a list of kinds
    """Write a small valid file of a kind."""
    match kind:
        case "csv":
            np.savetxt(path, NOISE, header="vib", comments="")
        case "wav":
            wavfile.write(path, 1000, (3000 * NOISE).astype(np.int16))
        case "mat v5":
            savemat(path, {"vib": NOISE, "notes": "text"})
        case "mat v5, packed":
            savemat(path, {"box": {"vib": NOISE}}, do_compression=True)
        case "mat v7.3":
            with h5py.File(path, "w", userblock_size=512) as file:
                file["vib"] = NOISE
                file["vib"].attrs["MATLAB_class"] = np.bytes_("double")
        case "hdf5":
            with h5py.File(path, "w") as file:
                file.create_dataset("vib", data=NOISE, chunks=(100,), compression="gzip", shuffle=True)
        case "tdms":
            _write_tdms(path)
        case "lvm":
            path.write_text(LVM + "\n".join(f"\t{value:.5f}\t" for value in NOISE) + "\n", encoding="utf-8")
        case "mf4":
            _write_mf4(path)
        case "csv with times" | "csv with stamps":
            stamps = np.datetime_as_string(np.datetime64("2024-10-27T00:59:59", "ms") + np.arange(COUNT), unit="ms")
            times = stamps if kind.endswith("stamps") else [f"{number / 1000:.4f}" for number in range(COUNT)]
            unit = "" if kind.endswith("stamps") else " (s)"
            rows = "".join(f"{time},{value:.5f}\n" for time, value in zip(times, NOISE, strict=True))
            path.write_text(f"time{unit},vib\n{rows}", encoding="utf-8")
        case "uff":
            _write_uff(path)
        case "npy":
            np.save(path, NOISE)
        case "npz":
            np.savez_compressed(path, vib=NOISE, other=NOISE[:10])
        case "record":
            hums.save_record(_record(), path)
        case "analysis":
            few = {where: small_analysis()[where].to_dataset() for where in ("/health", "/speed", "/gears")}
            write_tree(xr.DataTree.from_dict(few), path)
        case "gearbox":
            unnamed = hums.load_gearbox("two-stage").to_toml().partition("\n")[2]  # its file names it, as do errors
            path.write_text(unnamed, encoding="utf-8")
        case "scene":
            path.write_text(SCENE, encoding="utf-8")
        case "maintenance":
            path.write_text(WORK, encoding="utf-8")
        case "state":
            hums.watch(small_analysis(), path)


@cache
def _record() -> xr.Dataset:
    return hums.make_record({"vib": NOISE}, rate_hz=1000, units="g", angle=hums.UnknownAngle())


@cache
def small_analysis(seed: int = 20) -> xr.DataTree:
    """Return the analysis of a record of noise."""
    noise = np.random.default_rng(seed).normal(size=4000)
    angle = hums.NominalSpeed(rpm=1200, shaft="input")
    record = hums.make_record({"vib": noise}, rate_hz=2000, units="g", angle=angle)
    settings = hums.AnalysisSettings(pictures=False, most_tracks=0, envelope_band_hz=None)
    return hums.analyze(record, hums.load_gearbox("two-stage"), settings=settings)


def _write_tdms(path: Path) -> None:
    import nptdms  # noqa: PLC0415 - an optional part

    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [nptdms.ChannelObject("group", "vib", NOISE, properties={"unit_string": "g", "wf_increment": 1e-3})]
        )


def _write_mf4(path: Path) -> None:
    import asammdf  # noqa: PLC0415 - an optional part

    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(NOISE, np.arange(COUNT) * 1e-3, name="vib", unit="g")])
        file.save(path, overwrite=True)


def _write_uff(path: Path) -> None:
    import pyuff  # noqa: PLC0415 - an optional part

    entry = pyuff.prepare_58(
        binary=1, func_type=1, ver_num=0, load_case_id=0, rsp_ent_name="NONE", rsp_node=1, rsp_dir=0,
        ref_ent_name="NONE", ref_node=0, ref_dir=0, abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=1e-3,
        z_axis_value=0.0, abscissa_spec_data_type=17, ordinate_spec_data_type=12, orddenom_spec_data_type=0,
        ordinate_axis_units_lab="g", abscissa_axis_units_lab="s", id1="test", data=NOISE,
        x=np.arange(COUNT) * 1e-3,
    )  # fmt: skip
    with warnings.catch_warnings():  # pyuff leaves a file open that it writes
        warnings.simplefilter("ignore", ResourceWarning)
        pyuff.UFF(str(path)).write_sets(entry, mode="add")


# ---- damage ----------------------------------------------------------------------------------------------------------

_TOKEN = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?|true|false|\"[^\"\n]*\"")
ODD_TOKENS = (
    b"nan", b"inf", b"-1", b"0", b"1e308", b"1e-308", b"9" * 300, b"0.5", b"true", b'""', b'"x"', b"[]", b"{}",
    b"2026-01-01", b"[" * 5000, b'"' + b"y" * 5000 + b'"', b'"$x_1$"', b'"\\u0000"', b"[[1, 2], [3, 4]]", b"null",
    b"\xff", b'"=1+1"', b"9223372036854775808", b"-0.0", b"1_000",
)  # fmt: skip


def damaged(whole: bytes, rng: np.random.Generator) -> bytes:
    """Return a file with some bytes flipped, cut off, or overwritten by a size."""
    data, kind = bytearray(whole), rng.integers(4)
    if kind == 0:
        return bytes(data[: rng.integers(1, len(data))])
    for _ in range(rng.integers(1, 9)):
        at = int(rng.integers(len(data) if rng.random() < 0.5 else min(len(data), 4096)))  # noqa: PLR2004 - a fair coin
        if kind == 1:
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == 2:  # noqa: PLR2004
            data[at] = int(rng.integers(256))
        else:
            size = struct.pack("<I", SIZES[rng.integers(len(SIZES))])
            data[at : at + 4] = size[: len(data) - at]
    return bytes(data)


def reworded(whole: bytes, rng: np.random.Generator) -> bytes:
    """Return a text of which a value is replaced by an odd one, a line is gone or is there twice, or bytes differ."""
    kind = rng.integers(4)
    lines = whole.splitlines(keepends=True)
    if kind == 0:
        return damaged(whole, rng)
    if kind == 1 and len(lines) > 1:
        at = int(rng.integers(len(lines)))
        return b"".join([*lines[:at], *(2 * [lines[at]] if rng.random() < 0.5 else []), *lines[at + 1 :]])  # noqa: PLR2004
    for _ in range(int(rng.integers(1, 3))):
        found = list(_TOKEN.finditer(whole))
        if not found:
            break
        token = found[rng.integers(len(found))]
        whole = whole[: token.start()] + ODD_TOKENS[rng.integers(len(ODD_TOKENS))] + whole[token.end() :]
    return whole


# ---- what comes of it ------------------------------------------------------------------------------------------------


def outcome(kind: str, path: Path, reader: ReaderProcess, original: xr.Dataset | None) -> str:  # noqa: PLR0911
    """Return what came of a damaged file: one word, and a text where it is wrong."""
    if kind in TEXTS:
        return _outcome_here(TEXTS[kind], path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with _read(kind, path, reader) as found:
                found.load()
        except ValueError as error:
            text = str(error)
            if "the process that reads it" in text:
                return "crash contained" if "crashed" in text or "ended" in text else "stopped: time"
            if "needs more memory" in text:
                return "stopped: memory"
            ours = (
                path.name in text
                and len(text) <= LONGEST_MESSAGE
                and ("cannot be read (" not in text or "cannot be read (OSError" in text)
            )
            return "sentence" if ours else f"wrong: {text[:200]}"
        except Exception as error:  # noqa: BLE001 - all that should not be
            return f"wrong: {type(error).__name__}: {str(error)[:200]}"
    if kind != "record" or found.identical(original):
        return "read"
    return "read, with a warning" if caught else "wrong: other values, unseen"


def _read(kind: str, path: Path, reader: ReaderProcess) -> Any:  # noqa: ANN401 - a record or a tree
    if kind == "record":
        return reader.open_record(path)
    if kind == "analysis":
        return reader.open_tree(path)
    return reader.convert(path, channels=[CHANNELS.get(kind, "vib")], **DECLARED)


def _outcome_here(read: Callable[[Path], object], path: Path) -> str:
    said: list[str] = []

    def attempt() -> None:
        try:
            read(path)
        except Exception as error:
            said.append(str(error))
            raise

    if found := bounded(attempt):
        return f"wrong: {found}"
    if said and path.stem not in said[0]:
        return f"wrong: no name of the file: {said[0][:200]}"
    return "sentence" if said else "read"


COLUMNS = ("read", "read, with a warning", "sentence", "crash contained", "stopped: time", "stopped: memory", "wrong")


def attack_kind(kind: str, folder: Path, *, count: int, seed: Sequence[int]) -> dict[str, Any]:
    """Damage a file of a kind `count` times; return what came of it, how often, and what was wrong."""
    rng = np.random.default_rng(seed)
    path = folder / f"damaged{SUFFIXES.get(kind, '.h5')}"
    path.unlink(missing_ok=True)
    write_valid(kind, path)
    whole, begun = path.read_bytes(), time.perf_counter()
    damage = reworded if kind in TEXTS and kind != "state" else damaged
    found, wrong = Counter[str](), []
    with ReaderProcess(cpu_s=CPU_S, memory_bytes=MEMORY_BYTES) as reader:
        original = _record() if kind == "record" else None
        if (plain := outcome(kind, path, reader, original)) != "read":
            wrong.append(f"{kind}, undamaged: {plain}")
        for _ in range(count):
            path.write_bytes(damage(whole, rng))
            result = outcome(kind, path, reader, original)
            if result.startswith("wrong"):
                wrong.append(f"{kind}: {result}")
            found[result.split(":")[0] if result.startswith("wrong") else result] += 1
    return {"kind": kind, "count": count, "found": found, "wrong": wrong, "s": time.perf_counter() - begun}


def file_rows(parts: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the rows of a table, a kind of file each, of what its parts found."""
    rows = []
    for kind in dict.fromkeys(part["kind"] for part in parts):
        mine = [part for part in parts if part["kind"] == kind]
        found = sum((Counter(part["found"]) for part in mine), Counter[str]())
        cells = " | ".join(str(found[column]) for column in COLUMNS)
        rows.append(f"| {kind} | {sum(part['count'] for part in mine)} | {cells} | {sum(p['s'] for p in mine):.0f} |")
    return rows
