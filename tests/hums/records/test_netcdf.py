"""Files in netCDF4 layout: xarray reads from them what it reads from those it writes itself."""

from functools import partial

import h5py
import numpy as np
import pytest
import xarray as xr

from hums.records.store import open_tree, write_tree

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


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """The same groups in a file of ours and in one of xarray's."""
    folder = tmp_path_factory.mktemp("netcdf")
    write_tree(xr.DataTree.from_dict(DATASETS), folder / "ours.h5")
    xr.DataTree.from_dict(DATASETS).to_netcdf(folder / "theirs.h5", engine="h5netcdf")
    return folder / "ours.h5", folder / "theirs.h5"


@pytest.mark.parametrize("file", [0, 1])
def test_what_xarray_reads_is_read_and_written(both, file):
    with xr.open_datatree(both[1], engine="h5netcdf") as theirs:
        for read in (open_tree, partial(xr.open_datatree, engine="h5netcdf")):
            with read(both[file]) as ours:
                xr.testing.assert_identical(ours.load(), theirs.load())
                for node in theirs.subtree:
                    found = ours[node.path].variables
                    dtypes = {name: variable.dtype for name, variable in node.variables.items()}
                    assert {name: variable.dtype for name, variable in found.items()} == dtypes
                    assert list(found) == list(dtypes) or file == 0


def test_dimensions_and_types_are_those_of_the_netcdf_format(both):
    with h5py.File(both[0]) as file, h5py.File(both[1]) as expected:
        numbers = []
        file.visititems(lambda _, item: numbers.append(int(item.attrs.get("_Netcdf4Dimid", -1))))
        given = sorted(number for number in numbers if number >= 0)
        assert given == list(range(len(given)))
        for name in ("every kind/angle", "every kind/order", "words/fault", "empty/row"):
            assert file[name].attrs["NAME"] == expected[name].attrs["NAME"], name
            assert file[name].maxshape == expected[name].maxshape, name
        for name in ("every kind/line", "every kind/light"):
            assert file[name].id.get_type().committed()
        assert np.isnan(file["every kind/missing"].fillvalue)
