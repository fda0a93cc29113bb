"""The groups of an analysis as one tree."""

import numpy as np
import xarray as xr

from hums.analysis.result import tree_of


def test_the_tree_is_that_of_xarray():
    groups = {
        "/": xr.Dataset(attrs={"schema": "a"}),
        "/tracks": xr.Dataset(),
        "/lines": xr.Dataset(
            {"order": ("line", np.arange(3.0), {"units": "1"})}, coords={"kind": ("line", list("abc"))}
        ),
        "/pictures": xr.Dataset(),
        "/pictures/front": xr.Dataset({"values": ("sample", np.ones(4))}),
        "/pictures/rear/left": xr.Dataset({"values": ("sample", np.ones(5))}),  # below a group that is not given
    }
    made = tree_of(groups)
    assert made.identical(xr.DataTree.from_dict(groups))
    assert made["pictures/rear/left"].path == "/pictures/rear/left"
