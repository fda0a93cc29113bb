"""Every command without our docstrings, as under python -OO: it asks no network, and writes where it was told to.

Only our modules are compiled so: under -OO those of all libraries would be, too, for twenty seconds.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from gearboxes import SHORT_SCENE

from hums.records.record import NominalSpeed, make_record
from hums.records.store import save_record

COMMANDS = """
orders odd.toml --csv
bearings 6205
schema gearbox
schema plan
schema scene
drawing odd.toml -o pictures
drawing odd.toml -o page.html
dynamics wijianto-pair --motions torsion -o modes
convert raw.csv converted.h5 --channel vib --units g --rate-hz 5000 --no-tachometer
convert raw.csv raw.csv -o many --channel vib --units g --rate-hz 5000 --no-tachometer
info record.h5
info raw.csv --draft import.toml
analyze record.h5 --gearbox odd.toml -o out --no-envelope
report out/analysis.h5 -o again
fleet record.h5 --gearbox odd.toml -o fleet --no-envelope
synth scene.toml -o synthetic.h5
dataset plan.toml -o set
demo -o demo
"""
AUDITED = """
import os, sys, tempfile
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader, FileFinder, SourceFileLoader
from pathlib import Path

class WithoutDocstrings(SourceFileLoader):
    def get_code(self, name):
        if name.split(".")[0] not in {"signals", "hums", "data_synth"}:
            return super().get_code(name)
        return compile(self.get_data(self.path), self.path, "exec", optimize=2)

loaders = (ExtensionFileLoader, EXTENSION_SUFFIXES), (WithoutDocstrings, [".py"])
sys.path_hooks.insert(0, FileFinder.path_hook(*loaders))
sys.path_importer_cache.clear()
import data_synth, hums.cli, hums.jobs
assert hums.cli.main.__doc__ is None

inside = [os.getcwd(), "/dev/", "pipe:", os.path.join(Path.home(), ".cache"), os.path.join(Path.home(), ".config")]

def hook(event, args):
    if event in {"socket.connect", "socket.getaddrinfo", "urllib.Request"} and not isinstance(args[-1], str | bytes):
        os.write(2, f"AUDIT {event} {args[1:]}\\n".encode())
    if event == "open" and isinstance(args[0], str | bytes | os.PathLike):
        path, writes = os.path.realpath(os.fsdecode(args[0])), (args[2] or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        if writes and "__pycache__" not in path and not path.startswith(tuple(inside)):
            os.write(2, f"AUDIT {event} {path}\\n".encode())
    if event == "os.mkdir":
        made = os.path.realpath(os.fsdecode(args[0]))
        if "__pycache__" not in made and not made.startswith(tuple(inside)):
            os.write(2, f"AUDIT {event} {made}\\n".encode())

sys.addaudithook(hook)
hums.jobs.Processes = lambda **_: hums.jobs.Serial()
demo = data_synth.load_scene("demo").changed(duration_s=2.0, faults=())
whole, data_synth.load_scene = data_synth.load_scene, lambda name: demo if name == "demo" else whole(name)
for words in COMMANDS.strip().splitlines():
    sys.argv = ["hums", *words.split()]
    if status := hums.cli.main():
        os.write(2, f"STATUS {status} {words}\\n".encode())
"""
GEARBOX = """
name = "odd"
frame = "housing"
reference = "input"
axes = { input = ["housing", "input"], output = ["housing", "output"] }
mesh = [{ name = "=stage\\r1\\u001b[2J", teeth = { input = 23, output = 67 } }]
bearing = [{ name = "<b>DE\\u0007", inner_ring = "input", outer_ring = "housing", bearing = "SKF 6203-2RS JEM" }]
"""


def test_no_command_reaches_out_or_shows_a_control_character(tmp_path):
    time = np.arange(20_000) / 5000
    noise = np.cos(2 * np.pi * 23 * 20 * time) + np.random.default_rng(0).normal(0, 0.1, time.size)
    angle = NominalSpeed(rpm=1200, shaft="input")
    made = make_record({"vib": noise}, rate_hz=5000, units="g", angle=angle, machine="+mill\udcfc\r\x1b[2J")
    save_record(made, tmp_path / "record.h5")
    np.savetxt(tmp_path / "raw.csv", noise, header="vib", comments="")
    (tmp_path / "odd.toml").write_text(GEARBOX)
    (tmp_path / "scene.toml").write_text(SHORT_SCENE)
    (tmp_path / "plan.toml").write_text(
        'scene = "demo"\nrecords = 1\nseed = 7\n[change]\nduration_s = 0.2\nfault = []\n'
    )
    (tmp_path / "tmp").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", AUDITED.replace("COMMANDS", repr(COMMANDS))],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path / "tmp")},
        capture_output=True,
        check=False,
    )
    said = done.stderr.decode()
    assert done.returncode == 0, said
    assert not [line for line in said.splitlines() if line.startswith(("AUDIT", "STATUS", "hums:"))], said
    written = [path for path in tmp_path.rglob("*") if path.suffix in {".csv", ".html", ".svg"}]
    assert len(written) > 10
    texts = {str(path): path.read_bytes().decode().replace("\r\n", "\n") for path in written} | {
        "standard output": done.stdout.decode()
    }
    for name, text in texts.items():
        assert not set(text) & {"\r", "\x1b", "\x07"}, name
    for path in (Path(name) for name in texts if name.endswith(".csv") and "raw" not in name):
        rows = path.read_text().splitlines()
        assert not [row for row in rows if row.startswith(("=", "+", "@"))], path
