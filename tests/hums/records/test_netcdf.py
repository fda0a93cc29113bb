"""Files in netCDF4 layout: xarray reads from them what it reads from those it writes itself."""

import os
import subprocess
import sys

import h5py
import numpy as np
import pytest
import xarray as xr

from hums.records._netcdf import arrays_along, decoded, write_netcdf
from hums.records.record import Channel, PulseTimes, detach_time, make_record

DATASETS = {
    "/": xr.Dataset(attrs={"schema": "x/1", "words": ["a", "rød"], "row": np.array([1.0, 2.0]), "count": 3}),
    "/every kind": xr.Dataset(
        {
            "line": ("order", np.array([1 + 1j, np.nan])),
            "light": ("order", np.array([1 + 1j, np.nan], dtype=np.complex64)),
            "name": ("order", ["rød", ""]),
            "flag": ("order", [True, False]),
            "moment": ("order", np.array(["2020-01-01", "2021-01-01T00:00:01"], dtype="M8[ns]")),
            "span": ("order", np.array([1, 2], dtype="m8[s]")),
            "whole": ("order", np.array([1, -2], dtype=np.int16)),
            "missing": ("order", np.array([np.nan, 2.0], dtype=np.float32)),
            "number": ((), 2.0, {"units": "g", "scale": 2.5}),
            "text": ((), "hallo"),
            "table": (("order", "angle"), np.arange(6.0).reshape(2, 3)),
        },
        coords={"order": ("order", [20.0, 40.0], {"units": "1"}), "label": ("order", ["x", "y"]), "place": ((), 3.0)},
    ),
    "/every kind/below": xr.Dataset({"gain": ("order", np.zeros(2))}),
    "/words": xr.Dataset({"depth": ("fault", [0.5, np.nan])}, coords={"fault": ["crack", "spall"]}),
    "/empty": xr.Dataset({"none": ("row", np.zeros(0)), "words": ("row", np.zeros(0, dtype="<U1"))}),
}
CHUNKS = {"table": (1, 3), "line": (1,), "order": (2,)}


def read_back(path):
    with xr.open_datatree(path, engine="h5netcdf") as tree:
        return tree.load()


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """The same groups in a file of ours and in one of xarray's."""
    folder = tmp_path_factory.mktemp("netcdf")
    names = {where: dataset.variables.keys() & CHUNKS.keys() for where, dataset in DATASETS.items()}
    chunks = {where: {name: CHUNKS[name] for name in sorted(inside)} for where, inside in names.items()}
    write_netcdf(folder / "ours.h5", {where: (DATASETS[where], chunks[where]) for where in DATASETS})
    encoding = {
        where: {name: {"chunksizes": size, "fletcher32": True} for name, size in inside.items()}
        for where, inside in chunks.items()
    }
    xr.DataTree.from_dict(DATASETS).to_netcdf(folder / "theirs.h5", engine="h5netcdf", encoding=encoding)
    return folder / "ours.h5", folder / "theirs.h5"


def test_xarray_reads_what_it_would_have_written(both):
    ours, theirs = map(read_back, both)
    xr.testing.assert_identical(ours, theirs)
    for node in theirs.subtree:
        for name, variable in node.variables.items():
            assert ours[node.path].variables[name].dtype == variable.dtype, name
            stored, expected = (dict(v.encoding) for v in (ours[node.path].variables[name], variable))
            assert str(stored | {"source": ""}) == str(expected | {"source": ""}), name  # as text: NaN is NaN


def test_a_record_reads_as_xarray_would_have_written_it(tmp_path):
    rng = np.random.default_rng(3)
    record = make_record(
        {
            "case": Channel(values=rng.normal(size=2560), units="g", direction=(0, 0, 1)),
            "single": Channel(values=rng.normal(size=2560).astype(np.float32), units="m s-2", rate_hz=5120),
        },
        rate_hz=25_600,
        angle=PulseTimes(times_s=np.arange(0.01, 0.09, 0.01), shaft="input", pulses_per_rev=1),
        truth={"truth_phase": xr.DataArray(np.arange(3.0), dims="turn", coords={"turn": [1, 2, 3]})},
    )
    plain = detach_time(record)
    write_netcdf(tmp_path / "ours.h5", {"/": (plain, {"case": (2560,)})})
    plain.to_netcdf(tmp_path / "theirs.h5", engine="h5netcdf")
    with (
        xr.open_dataset(tmp_path / "ours.h5", engine="h5netcdf") as ours,
        xr.open_dataset(tmp_path / "theirs.h5", engine="h5netcdf") as theirs,
    ):
        xr.testing.assert_identical(ours.load(), theirs.load())
        assert list(ours.data_vars) == list(theirs.data_vars)


def test_every_dimension_has_a_number_and_a_scale_of_its_own(both):
    def scales(path):
        found = {}

        def visit(name, item):
            if isinstance(item, h5py.Dataset) and item.is_scale:
                found[name] = int(item.attrs["_Netcdf4Dimid"])

        with h5py.File(path) as file:
            file.visititems(visit)
        return found

    ours, theirs = map(scales, both)
    assert ours.keys() == theirs.keys()
    assert sorted(ours.values()) == list(range(len(ours)))


def test_dimensions_and_types_are_those_of_the_netcdf_format(both):
    ours, theirs = both
    with h5py.File(ours) as file, h5py.File(theirs) as expected:
        for name in ("every kind/angle", "every kind/order", "words/fault", "empty/row"):
            assert file[name].attrs["NAME"] == expected[name].attrs["NAME"], name
            assert file[name].maxshape == expected[name].maxshape, name
        for name in ("every kind/line", "every kind/light"):
            assert file[name].id.get_type().committed()
        for name, chunk in CHUNKS.items():
            assert file["every kind"][name].chunks == chunk
            assert file["every kind"][name].fletcher32
        assert file["every kind/below/gain"].dims[0][0] == file["every kind/order"]
        assert np.isnan(file["every kind/missing"].fillvalue)


def test_the_same_groups_make_the_same_bytes_in_every_process(tmp_path):
    code = (
        "import numpy as np, xarray as xr; from hums.records._netcdf import write_netcdf; "
        "parts = [xr.Dataset({f'v{i}': (f'd{i}', np.arange(i + 2.0))}) for i in range(5)]; "
        "write_netcdf('file.h5', {'/': (xr.merge(parts), {})}); print(open('file.h5', 'rb').read().hex())"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    made = {
        subprocess.run(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            env={**environment, "PYTHONHASHSEED": seed},
            capture_output=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(made) == 1


def test_arrays_along_a_dimension_are_those_that_xarray_reads(tmp_path):
    rows = {name: DATASETS["/every kind"][name] for name in ("name", "flag", "whole", "missing", "light", "table")}
    other = xr.DataArray(np.zeros(3), dims="angle")
    dataset = xr.Dataset({**rows, "other": other}, attrs={"x": 1}).drop_vars(["order", "label", "place"])
    dataset["missing"].attrs = {"units": "g", "direction": np.array([0.0, 1.0]), "number": 3}
    write_netcdf(tmp_path / "file.h5", {"/": (dataset, {})})
    with h5py.File(tmp_path / "file.h5") as file:
        found = {name: decoded(*array) for name, array in arrays_along(file, "order").items()}
    with xr.open_dataset(tmp_path / "file.h5", engine="h5netcdf") as opened:
        xr.testing.assert_identical(xr.Dataset(found), opened.load().drop_vars("other").drop_attrs(deep=False))
