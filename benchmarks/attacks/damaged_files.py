"""Damaged files of every reader, made from small valid ones, and what comes of them."""

from __future__ import annotations

import struct
import time
import warnings
from collections import Counter
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from scipy.io import savemat, wavfile

import hums
from hums.readers.process import ReaderProcess

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr

COUNT = 400  # samples of a file: small ones have most of their bytes in headers
CPU_S = 5.0
MEMORY_BYTES = 1 << 30
LONGEST_MESSAGE = 1000
SIZES = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
NOISE = np.random.default_rng(20).normal(size=COUNT)
DECLARED: dict[str, Any] = {"units": "g", "rate_hz": 1000.0, "no_tachometer": True}


def valid_files(folder: Path) -> dict[str, tuple[Path, str]]:
    """Write a small valid file for each reader; return its path and the name of its channel."""
    files = {
        "csv": ("a.csv", "vib"), "wav": ("a.wav", "channel 1"), "mat v5": ("a5.mat", "vib"),
        "mat v5, packed": ("a6.mat", "box.vib"), "mat v7.3": ("a7.mat", "vib"), "hdf5": ("a.h5", "vib"),
        "tdms": ("a.tdms", "group.vib"), "uff": ("a.uff", "1"), "record": ("record.h5", ""),
    }  # fmt: skip
    found = {kind: (folder / name, channel) for kind, (name, channel) in files.items()}
    np.savetxt(found["csv"][0], NOISE, header="vib", comments="")
    wavfile.write(found["wav"][0], 1000, (3000 * NOISE).astype(np.int16))
    savemat(found["mat v5"][0], {"vib": NOISE, "notes": "text"})
    savemat(found["mat v5, packed"][0], {"box": {"vib": NOISE}}, do_compression=True)
    with h5py.File(found["mat v7.3"][0], "w", userblock_size=512) as file:
        file["vib"] = NOISE
        file["vib"].attrs["MATLAB_class"] = np.bytes_("double")
    with h5py.File(found["hdf5"][0], "w") as file:
        file.create_dataset("vib", data=NOISE, chunks=(100,), compression="gzip", shuffle=True)
    _write_tdms(found["tdms"][0])
    _write_uff(found["uff"][0])
    record = hums.make_record({"vib": NOISE}, rate_hz=1000, units="g", angle=hums.UnknownAngle())
    hums.save_record(record, found["record"][0])
    return found


def _write_tdms(path: Path) -> None:
    import nptdms  # noqa: PLC0415 - an optional part

    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.ChannelObject("group", "vib", NOISE, properties={"unit_string": "g"})])


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


def outcome(reader: ReaderProcess, path: Path, channel: str, original: xr.Dataset | None) -> str:
    """Return what came of a damaged file: one word, and a text where it is wrong."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with (
                reader.open_record(path)
                if original is not None
                else reader.convert(path, channels=[channel], **DECLARED)
            ) as record:
                record.load()
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
    if original is None or record.identical(original):
        return "read"
    return "read, with a warning" if caught else "wrong: other values, unseen"


COLUMNS = ("read", "read, with a warning", "sentence", "crash contained", "stopped: time", "stopped: memory", "wrong")


def attack_files(folder: Path, *, count: int, seed: int = 20) -> tuple[list[str], list[str]]:
    """Return the rows of a table, a reader each, and sentences on what went wrong."""
    rows, wrong = [], []
    rng = np.random.default_rng(seed)
    with ReaderProcess(cpu_s=CPU_S, memory_bytes=MEMORY_BYTES) as reader:
        for kind, (path, channel) in valid_files(folder).items():
            original = hums.open_record(path).load() if kind == "record" else None
            whole, victim = path.read_bytes(), path.with_name(f"damaged{path.suffix}")
            victim.write_bytes(whole)
            if (plain := outcome(reader, victim, channel, original)) != "read":
                wrong.append(f"{kind}, undamaged: {plain}")
            found, begun = Counter[str](), time.perf_counter()
            for _ in range(count):
                victim.write_bytes(damaged(whole, rng))
                result = outcome(reader, victim, channel, original)
                if result.startswith("wrong"):
                    wrong.append(f"{kind}: {result}")
                found[result.split(":")[0] if result.startswith("wrong") else result] += 1
            cells = " | ".join(str(found[column]) for column in COLUMNS)
            rows.append(f"| {kind} | {count} | {cells} | {time.perf_counter() - begun:.0f} |")
    return rows, wrong
