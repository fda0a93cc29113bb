"""The command line `hums`."""

import gc
import logging
import math
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import typer

from hums.cli.options import parse_speeds
from hums.cli.pictures import bearings, drawing, dynamics

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from hums.analysis.settings import AnalysisSettings
    from hums.gearbox.kinematics import Kinematics
    from hums.jobs import Workers
    from hums.readers.process import ReaderProcess

__all__ = ["main", "print_orders", "print_record"]


# ---- Console output of tables of orders and of records ---------------------------------------------------------------


def print_orders(table: "pd.DataFrame", *, csv: bool, json: bool) -> None:
    """Print a table of orders as text, CSV or JSON."""
    fractions = table["exact"].map(str, na_action="ignore")
    if csv:
        spacings = table["sidebands"].map(lambda row: " ".join(map(str, row)))
        typer.echo(table.assign(sidebands=spacings).to_csv(index=False), nl=False)
    elif json:
        spacings = table["sidebands"].map(lambda row: [float(spacing) for spacing in row])
        plain = table.assign(exact=fractions, sidebands=spacings)
        typer.echo(plain.to_json(orient="records", double_precision=15))
    else:
        plain = table.assign(exact=fractions.fillna("")).drop(columns="sidebands")
        typer.echo(plain.to_string(index=False, formatters={"order": "{:.6f}".format, "hz": "{:.6g}".format}))


def print_record(record: "xr.Dataset") -> None:
    """Print what a record holds, a line for each channel and tachometer."""
    from hums.records.record import nominal_speed, sampling, speed_percentiles, tachometers, vibration_channels  # noqa: PLC0415

    for label, key in (("machine", "machine"), ("recorded at", "recorded_at")):
        if record.attrs.get(key):
            typer.echo(f"{label:<12} {record.attrs[key]}")
    for name in vibration_channels(record):
        when, attrs = sampling(record, name), record[name].attrs
        where = "".join(f", {attrs[key]}" for key in ("sensor", "direction") if key in attrs)
        typer.echo(
            f"{'channel':<12} {name}: {when.count} samples at {when.rate_hz:g} Hz, "
            f"{when.count / when.rate_hz:.3f} s from {when.start_s:g} s, in {attrs['units']}{where}"
        )
    for name in tachometers(record):
        attrs, speeds = record[name].attrs, speed_percentiles(record[name])
        about = "" if speeds is None else ", about {:.4g} rev/s (98 % of revolutions {:.4g} to {:.4g})".format(*speeds)
        typer.echo(
            f"{'tachometer':<12} {name}: {record[name].size} pulses, {attrs['pulses_per_rev']} a revolution of "
            f"{attrs['shaft']}{about}"
        )
    declared = nominal_speed(record)
    if declared is not None:
        typer.echo(f"{'speed':<12} {float(declared) * 60:g} rpm of {declared.attrs['shaft']}, declared (nominal)")
    truth = [str(name) for name in record.data_vars if str(name).startswith("truth_")]
    if truth:
        typer.echo(f"{'truth':<12} {', '.join(truth)}")


# ---- Cli -------------------------------------------------------------------------------------------------------------


app = typer.Typer(
    name="hums",
    help="Order tracking for gearboxes: kinematics, records, analyses, reports, synthetic data.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

Out = Annotated[Path, typer.Option("--out", "-o", help="Folder to write into.")]
Band = Annotated[
    Optional[tuple[float, float]],  # noqa: UP045  (typer reads this form)
    typer.Option(
        "--envelope-band",
        metavar="LOW HIGH",
        help="Band to demodulate, Hz. Default: one is chosen for each channel, and the report says why.",
    ),
]
NoEnvelope = Annotated[bool, typer.Option("--no-envelope", help="Search no bearing line.")]
Channels = Annotated[list[str] | None, typer.Option(help="Channel to analyse; repeat. Default all.")]
Tachometer = Annotated[str | None, typer.Option(help="Tachometer that measures the shaft angle. Default the first.")]
SpeedRange = Annotated[
    Optional[tuple[float, float]],  # noqa: UP045  (typer reads this form)
    typer.Option(
        metavar="LOW HIGH",
        help="Without a tachometer: range of the reference's speed, rev/s; needs --max-acceleration.",
    ),
]
MaxAcceleration = Annotated[
    float | None, typer.Option(metavar="HZ_PER_S", help="How fast that speed may change, rev/s in a second.")
]
SpeedUnits = Annotated[Literal["rpm", "Hz"], typer.Option("--units", help="Of speeds: which of the two comes first.")]
VelocityLimits = Annotated[
    Optional[tuple[float, float, float]],  # noqa: UP045  (typer reads this form)
    typer.Option(
        "--velocity-limits",
        metavar="AB BC CD",
        help="Between the zones of ISO 20816, RMS velocity in mm/s, from the part of the standard for this machine.",
    ),
]
MachineClass = Annotated[str, typer.Option("--machine-class", help="That part and class, which the report states.")]
WorkerCount = Annotated[
    int | None, typer.Option("--workers", metavar="N", help="Processes to work in. Default one a processor.")
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Scheduler of a Dask cluster to work on, tcp://HOST:PORT.")
]


def _print_version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version  # noqa: PLC0415

        typer.echo(f"hums {version('hums-toolkit')}")
        raise typer.Exit


@app.callback()
def common(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Order tracking for gearboxes: kinematics, records, analyses, reports, synthetic data."""


for command in (drawing, dynamics, bearings):
    app.command()(command)


@app.command()
def orders(
    gearbox: Annotated[str, typer.Argument(help="A .toml file or a catalogue name.")],
    reference: Annotated[str | None, typer.Option(help="Shaft whose revolutions orders count.")] = None,
    speed: Annotated[list[str] | None, typer.Option(metavar="LINK=RPM", help="Speed of a link; repeat.")] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Print comma-separated values.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    plot: Annotated[Path | None, typer.Option(help="Draw the lines against speed: .svg, .png or .pdf.")] = None,
    rpm: Annotated[float | None, typer.Option(help="Speed of the reference: adds the frequencies in Hz.")] = None,
    plot_rpm: Annotated[
        Optional[tuple[float, float]],  # noqa: UP045  (typer reads this form)
        typer.Option(metavar="LOW HIGH", help="Speeds of the reference to draw, up to the given one or 3000."),
    ] = None,
) -> None:
    """Print the defect orders of a gearbox."""
    from hums.gearbox.kinematics import solve_kinematics  # noqa: PLC0415
    from hums.gearbox.model import load_gearbox  # noqa: PLC0415
    from hums.gearbox.orders import defect_orders  # noqa: PLC0415

    if csv and json:
        raise ValueError("--csv and --json are both given; keep one.")
    if plot_rpm and not plot:
        raise ValueError("--plot-rpm says which speeds to draw; add --plot FILE.")
    if rpm is not None and not (math.isfinite(rpm) and rpm):
        raise ValueError(f"--rpm {rpm:g}: give the speed of the reference, in rpm, other than 0.")
    speeds = parse_speeds(speed)
    kinematics = solve_kinematics(load_gearbox(gearbox))
    table = defect_orders(kinematics, reference=reference, speeds=speeds)
    top = abs(rpm) if rpm is not None else _reference_rpm(kinematics, reference, speeds)
    if rpm is not None:
        table.insert(list(table.columns).index("exact"), "hz", table["order"] * top / 60)
    if plot:
        _plot_orders(table, plot_rpm or (top / 10, top), plot)
    print_orders(table, csv=csv, json=json)


@app.command()
def schema(
    of: Annotated[
        Literal["gearbox", "scene", "plan"],
        typer.Argument(metavar="KIND", help="The kind of file: gearbox, scene or plan (of a dataset)."),
    ],
) -> None:
    """Print the JSON schema of a hand-written file, for editors that check and complete it."""
    import json  # noqa: PLC0415

    from data_synth.schema import plan_schema, scene_schema  # noqa: PLC0415
    from hums.gearbox.model import gearbox_schema  # noqa: PLC0415

    gearbox = gearbox_schema()
    schemas = {"gearbox": lambda: gearbox, "scene": lambda: scene_schema(gearbox), "plan": plan_schema}
    typer.echo(json.dumps(schemas[of](), indent=2))


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(help="A .mat, .wav, .csv, .tdms, .uff or .h5 file.")],
    target: Annotated[Path, typer.Argument(help="The record to write, .h5.")],
    channel: Annotated[list[str], typer.Option(help="Vibration channel; repeat. Struct fields by dotted path.")],
    units: Annotated[
        str | None,
        typer.Option(help='Units of the channels, such as g or "m s-2"; a .tdms or .uff file may state them.'),
    ] = None,
    rate_hz: Annotated[
        float | None, typer.Option(help="Samples a second; a .wav, .tdms or .uff file may state them.")
    ] = None,
    tach_times: Annotated[str | None, typer.Option(help="Variable that holds pulse times, s.")] = None,
    tach_waveform: Annotated[str | None, typer.Option(help="Channel that holds a tachometer waveform.")] = None,
    shaft_rpm: Annotated[float | None, typer.Option(help="Declared constant speed, rpm.")] = None,
    shaft: Annotated[str | None, typer.Option(help="Shaft that the tachometer or the speed belongs to.")] = None,
    pulses_per_rev: Annotated[int | None, typer.Option(help="Tachometer pulses a revolution.")] = None,
    no_tachometer: Annotated[
        bool,
        typer.Option("--no-tachometer", help="No shaft angle is measured; hums analyze --speed-range estimates it."),
    ] = False,
    scale: Annotated[float, typer.Option(help="Factor from the file's numbers to the units.")] = 1.0,
    machine: Annotated[str, typer.Option(help="Name of the machine.")] = "",
    recorded_at: Annotated[str | None, typer.Option(help="Time of the record, ISO 8601 with offset.")] = None,
    most_bytes: Annotated[
        int | None, typer.Option(help="Bytes that one array may take. Default 100 times the file's size.")
    ] = None,
) -> None:
    """Turn another program's file into a record."""
    from hums.readers.process import ReaderProcess  # noqa: PLC0415
    from hums.records.store import save_record  # noqa: PLC0415

    if source.exists() and target.exists() and source.samefile(target):
        raise ValueError(f"{target}: the record would overwrite its own source, {source}; name another target.")
    if target.suffix.lower() not in RECORD_SUFFIXES:
        raise ValueError(f"{target}: a record is HDF5, so name it so: {target.with_suffix('.h5')}.")
    _say(f"reading {source}")
    with ReaderProcess() as reader:
        record = reader.convert(
            source,
            channels=channel,
            rate_hz=rate_hz,
            units=units,
            tach_times=tach_times,
            tach_waveform=tach_waveform,
            pulses_per_rev=pulses_per_rev,
            shaft=shaft,
            shaft_rpm=shaft_rpm,
            no_tachometer=no_tachometer,
            scale=scale,
            machine=machine,
            recorded_at=recorded_at,
            most_bytes=most_bytes,
        )
        save_record(record, target)
        typer.echo(f"wrote {target}")
        print_record(record)


@app.command()
def info(record: Annotated[Path, typer.Argument(help="A record, .h5.")]) -> None:
    """Print what is inside a record."""
    from hums.readers.process import ReaderProcess  # noqa: PLC0415

    with ReaderProcess() as reader, reader.open_record(record) as opened:
        print_record(opened)


@app.command()
def analyze(
    record: Annotated[Path, typer.Argument(help="A record, .h5.")],
    gearbox: Annotated[str, typer.Option(help="A .toml file or a catalogue name.")],
    out: Out,
    *,
    envelope_band: Band = None,
    no_envelope: NoEnvelope = False,
    channel: Channels = None,
    tachometer: Tachometer = None,
    speed_range: SpeedRange = None,
    max_acceleration: MaxAcceleration = None,
    baseline: Annotated[
        Path | None,
        typer.Option(help="analysis.h5 of the previous record, to whose variances NA4 and NB4 refer."),
    ] = None,
    freeze_baseline: Annotated[
        bool, typer.Option("--freeze-baseline", help="Leave those variances as they are: NA4* and NB4*.")
    ] = False,
    false_alarm_probability: Annotated[float, typer.Option(help="For the whole record.")] = 0.01,
    max_order: Annotated[float | None, typer.Option(help="Where the order spectrum ends.")] = None,
    track_bandwidth: Annotated[float | None, typer.Option(help="Bandwidth of amplitude tracks, orders.")] = None,
    velocity_limits: VelocityLimits = None,
    machine_class: MachineClass = "",
    units: SpeedUnits = "rpm",
) -> None:
    """Analyse a record and write the report."""
    from hums.analysis.analyze import analyze as run  # noqa: PLC0415
    from hums.analysis.findings import where_none_is_named  # noqa: PLC0415
    from hums.analysis.result import summary  # noqa: PLC0415
    from hums.gearbox.model import load_gearbox  # noqa: PLC0415
    from hums.readers.process import ReaderProcess  # noqa: PLC0415
    from hums.report import prepare_folder, speed_text, write_report  # noqa: PLC0415

    settings = _settings(
        channels=tuple(channel) if channel else None,
        tachometer=tachometer,
        speed_range_hz=speed_range,
        max_acceleration_hz_s=max_acceleration,
        envelope_band_hz=envelope_band,
        no_envelope=no_envelope,
        freeze_baseline=freeze_baseline,
        false_alarm_probability=false_alarm_probability,
        max_order=max_order,
        track_bandwidth_orders=track_bandwidth,
        velocity_limits_mm_s=velocity_limits,
        machine_class=machine_class,
    )
    with (
        ReaderProcess() as reader,
        reader.open_record(record) as opened,
        _past(reader, baseline) if baseline else nullcontext() as past,
    ):
        prepare_folder(out)
        analysis = run(opened, load_gearbox(gearbox), settings=settings, baseline=past)
        _say("writing the report")
        page = write_report(analysis, out, baseline=past, units=units)
    facts = summary(analysis)
    typer.echo(f"speed of {facts['reference']}: {speed_text(facts, units=units)}")
    for note in facts["notes"]:
        typer.echo(f"note: {note}")
    for item in facts["health"]:
        if item["status"] != "ok":
            typer.echo(f"{item['status']} {item['sensor']} {item['name']}: {item['reasons']}")
    for finding in facts["findings"]:
        kind = finding["kind"].replace("_", " ")
        typer.echo(f"{finding['verdict']}: {finding['component']}, {kind}: {finding['evidence']}")
    if not facts["findings"]:
        typer.echo(": ".join(where_none_is_named(facts["verdicts"])))
    typer.echo(f"report: {page}")


@contextmanager
def _past(reader: "ReaderProcess", path: Path) -> Iterator["xr.DataTree"]:
    """Open an earlier analysis in the process that reads files."""
    from hums.analysis.result import check_analysis  # noqa: PLC0415

    with reader.open_tree(path) as tree:
        try:
            check_analysis(tree)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        yield tree


@app.command()
def report(
    analysis: Annotated[Path, typer.Argument(help="An analysis, such as the analysis.h5 of an earlier report.")],
    out: Out,
    baseline: Annotated[
        Path | None, typer.Option(help="analysis.h5 of an earlier record: what has changed since, spectra beneath.")
    ] = None,
    units: SpeedUnits = "rpm",
    pdf: Annotated[bool, typer.Option("--pdf", help="Print the page to report.pdf, too, through Chromium.")] = False,
) -> None:
    """Make the report again from a saved analysis."""
    from hums.analysis.result import open_analysis  # noqa: PLC0415
    from hums.report import prepare_folder, write_report  # noqa: PLC0415
    from hums.report.pdf import write_pdf  # noqa: PLC0415

    prepare_folder(out)
    with open_analysis(analysis) as opened, open_analysis(baseline) if baseline else nullcontext() as past:
        _say("writing the report")
        page = write_report(opened.load(), out, baseline=past, units=units)
    typer.echo(f"report: {page}")
    if pdf:
        _say("printing")
        typer.echo(f"printed: {write_pdf(page)}")


@app.command()
def synth(
    scene: Annotated[str, typer.Argument(help="A scene, .toml, or a catalogue name.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="The record to write, .h5.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    explain: Annotated[bool, typer.Option("--explain", help="Print what will be built, why, and its cost.")] = False,
    by_source: Annotated[bool, typer.Option("--by-source", help="Also keep the clean signal of each source.")] = False,
    phases: Annotated[bool, typer.Option("--phases", help="Also keep every shaft's and roller's exact angle.")] = False,
    mechanics: Annotated[
        bool, typer.Option("--mechanics", help="Also keep mesh deflections, forces, stiffness and all speeds.")
    ] = False,
    detectability: Annotated[
        bool, typer.Option("--detectability", help="Also state how detectable each fault is, in dB.")
    ] = False,
) -> None:
    """Make a synthetic record with its truth."""
    from data_synth import explain as explained  # noqa: PLC0415
    from data_synth import simulate  # noqa: PLC0415
    from data_synth.cost import refuse_too_large  # noqa: PLC0415
    from hums.records.store import save_record  # noqa: PLC0415

    if explain:
        typer.echo(str(explained(scene)))
    if out is None:
        if explain:
            return
        raise ValueError("--out is missing; name the record to write, as in -o record.h5, or ask with --explain.")
    if out.exists() and Path(scene).exists() and out.samefile(scene):
        raise ValueError(f"{out}: the record would overwrite its own scene; name another file, as in -o record.h5.")
    refuse_too_large(scene, out, by_source=by_source, phases=phases, mechanics=mechanics)
    _say(f"simulating {scene}")
    record = simulate(
        scene, seed=seed, by_source=by_source, phases=phases, mechanics=mechanics, detectability=detectability
    )
    save_record(record, out)
    typer.echo(f"wrote {out}")
    print_record(record)


@app.command()
def dataset(
    plan: Annotated[str, typer.Argument(help="A plan, .toml, or a catalogue name.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the dataset; the same again goes on with it.")],
    workers: WorkerCount = None,
    scheduler: Scheduler = None,
) -> None:
    """Make a labelled dataset of synthetic records, or go on with one that was stopped."""
    from data_synth import load_plan, make_dataset  # noqa: PLC0415
    from data_synth.dataset import dataset_cost  # noqa: PLC0415

    declared, chosen = load_plan(plan), _workers(workers, scheduler)
    cost = dataset_cost(declared)
    typer.echo(
        f"{declared.records} records of {declared.record_bytes / 1e6:.3g} MB are {cost.size_bytes / 1e6:.3g} MB of "
        f"samples; about {cost.seconds / 60:.2g} minutes of one core"
    )
    tally = make_dataset(declared, out, workers=chosen, progress=True)
    before = f", {tally.kept} of their {tally.kept + tally.done} files made before" if tally.kept else ""
    typer.echo(f"{out}: {declared.records} records{before}")
    typer.echo(f"classes: {', '.join(declared.classes)}")
    typer.echo(f'open it: hums.open_dataset("{out}")')


@app.command()
def fleet(  # noqa: PLR0917 - each option is one
    records: Annotated[list[Path], typer.Argument(help="Records, folders of records, datasets.")],
    gearbox: Annotated[str, typer.Option(help="A .toml file or a catalogue name.")],
    out: Out,
    envelope_band: Band = None,
    no_envelope: NoEnvelope = False,
    channel: Channels = None,
    tachometer: Tachometer = None,
    speed_range: SpeedRange = None,
    max_acceleration: MaxAcceleration = None,
    false_alarm_probability: Annotated[float, typer.Option(help="For each record.")] = 0.01,
    baseline_records: Annotated[
        int, typer.Option(metavar="N", help="Learn what is normal from the first N records of a machine.")
    ] = 30,
    baseline_span: Annotated[
        Optional[tuple[str, str]],  # noqa: UP045  (typer reads this form)
        typer.Option(metavar="FROM UNTIL", help="Learn it from the records of this span of time, ISO 8601."),
    ] = None,
    healthy: Annotated[
        list[str] | None, typer.Option(help="Learn it from this record, declared healthy; repeat.")
    ] = None,
    false_alarm_every: Annotated[
        float, typer.Option(metavar="RECORDS", help="Mean number of records of a machine between false alarms.")
    ] = 10_000.0,
    maintenance: Annotated[
        Path | None, typer.Option(help="CSV file: date, component, machine, serial, action (replaced, acknowledged).")
    ] = None,
    append: Annotated[
        bool, typer.Option("--append", help="Add the records to those that the folder holds from earlier runs.")
    ] = False,
    workers: WorkerCount = None,
    scheduler: Scheduler = None,
) -> None:
    """Analyse many records into one table with trends and alarms; the same again goes on, with new records too."""
    from hums.fleet.fleet import analyze_fleet  # noqa: PLC0415
    from hums.fleet.monitor import MonitorSettings  # noqa: PLC0415
    from hums.fleet.parquet import NO_PYARROW  # noqa: PLC0415

    if baseline_span and healthy:
        raise ValueError("--baseline-span and --healthy are both given; keep one.")
    span = baseline_span or ("", "")
    monitoring = MonitorSettings(
        baseline_records=baseline_records,
        baseline_from=span[0],
        baseline_until=span[1],
        healthy=tuple(healthy or ()),
        false_alarm_every=false_alarm_every,
    )

    settings = _settings(
        channels=tuple(channel) if channel else None,
        tachometer=tachometer,
        speed_range_hz=speed_range,
        max_acceleration_hz_s=max_acceleration,
        envelope_band_hz=envelope_band,
        no_envelope=no_envelope,
        false_alarm_probability=false_alarm_probability,
        most_tracks=0,
        pictures=False,
    )
    result = analyze_fleet(
        records,
        gearbox,
        out,
        settings=settings,
        workers=_workers(workers, scheduler),
        progress=True,
        monitoring=monitoring,
        maintenance=maintenance,
        append=append,
    )
    typer.echo(
        f"{result.records} records: {result.analysed} analysed now, {result.kept} before, {result.failed} failed"
    )
    for name, reason in list(result.errors.items())[:SHOWN_FAILURES]:
        typer.echo(f"failed {name}: {reason}")
    if result.failed > SHOWN_FAILURES:
        typer.echo(f"and {result.failed - SHOWN_FAILURES} more: see the column error of fleet.csv")
    if result.no_trends:
        typer.echo(result.no_trends)
    typer.echo(f"{result.alarms} alarms; one in {false_alarm_every:g} records of a machine would be false")
    for name in ("fleet.html", "fleet.csv", "fleet.h5", "trends.csv", "alarms.csv", "components.csv", "baseline.h5"):
        typer.echo(f"wrote {result.folder / name}")
    parquet = result.folder / "indicators.parquet"
    typer.echo(f"wrote {parquet}" if parquet.is_file() else NO_PYARROW)
    if result.failed == result.records:
        raise ValueError("no record could be analysed; the column error of fleet.csv says why.")


@app.command()
def demo(
    out: Out = Path("hums-demo"),
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 1,
) -> None:
    """Simulate a gearbox with a cracked tooth and an inner-race fault, analyse it, and compare with the truth."""
    from data_synth import load_scene, simulate  # noqa: PLC0415
    from hums.analysis.analyze import AnalysisSettings  # noqa: PLC0415
    from hums.analysis.analyze import analyze as run  # noqa: PLC0415
    from hums.analysis.result import findings_table  # noqa: PLC0415
    from hums.analysis.score import score  # noqa: PLC0415
    from hums.gearbox.model import load_gearbox  # noqa: PLC0415
    from hums.records.store import open_record, save_record  # noqa: PLC0415
    from hums.report import prepare_folder, write_report  # noqa: PLC0415

    scene = load_scene("demo")
    prepare_folder(out)
    _say("simulating a gearbox with two faults")
    save_record(simulate(scene, seed=seed), out / "record.h5")
    with open_record(out / "record.h5") as record:
        analysis = run(record, load_gearbox("two-stage"), settings=AnalysisSettings(envelope_band_hz=DEMO_BAND_HZ))
        result = score(analysis, record)
    _say("writing the report")
    page = write_report(analysis, out)
    typer.echo("Truth against estimate, peak amplitudes in g:")
    columns = ["component", "kind", "order", "true_amplitude", "amplitude", "std", "normalised_rms"]
    typer.echo(result.tracks[columns].to_string(index=False, float_format="{:.4f}".format))
    typer.echo(f"\nError of each quadrature over its std, RMS of all: {result.normalised_rms:.3f} (1 is honest)\n")
    typer.echo("Faults of the scene, and the verdict on each:")
    typer.echo(result.faults.to_string(index=False))
    typer.echo("\nFindings:")
    for finding in findings_table(analysis).itertuples():
        typer.echo(f"  {finding.verdict}: {finding.component}, {str(finding.kind).replace('_', ' ')}")
    typer.echo(f"\nreport: {page.resolve()}")


DEMO_BAND_HZ = (6000.0, 10000.0)
DRAWN_RPM = 3000.0
SHOWN_FAILURES = 5
RECORD_SUFFIXES = (".h5", ".hdf5")


def main() -> int:
    """Run the command and return its exit code; an error of the user prints one sentence and returns 2."""
    _show_steps()
    gc.set_threshold(50_000)  # imports make objects that stay; collecting among them is a tenth of a short run
    with warnings.catch_warnings():
        warnings.showwarning = _print_warning
        try:
            app(standalone_mode=False)
        except typer.Exit as stop:
            return stop.exit_code
        except typer.Abort:
            return 130
        except (ValueError, OSError) as error:
            typer.echo(f"hums: {error}", err=True)
            return 2
        except Exception as error:
            if error.__class__.__module__.split(".")[0] not in {"click", "typer"}:
                raise
            error.show()  # type: ignore[attr-defined]
            return 2
    return 0


def _say(step: str) -> None:
    """Say what begins, as the packages do through the logger "hums"."""
    logging.getLogger("hums").info(step)


def _show_steps() -> None:
    """Show the steps of a command on standard error as they begin, each text once; nothing where that is piped."""
    logger = logging.getLogger("hums")
    if not sys.stderr.isatty() or logger.handlers:
        return
    shown: set[str] = set()

    def new(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        return not (text in shown or shown.add(text))  # type: ignore[func-returns-value]

    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("hums: %(message)s"))
    handler.addFilter(new)
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)


def _print_warning(message: Warning | str, *_: object, **__: object) -> None:
    typer.echo(f"warning: {message}", err=True)


def _workers(count: int | None, scheduler: str | None) -> "Workers":
    from hums.jobs import Cluster, Processes  # noqa: PLC0415

    if count is not None and scheduler is not None:
        raise ValueError("--workers and --scheduler are both given; keep one.")
    if scheduler is not None:
        return Cluster(address=scheduler)
    return Processes(count=os.cpu_count() or 1 if count is None else count)


def _settings(*, no_envelope: bool, **chosen: Any) -> "AnalysisSettings":  # noqa: ANN401  (each option keeps its own type)
    """Return the settings given by options; the others keep their defaults."""
    from hums.analysis.settings import AnalysisSettings  # noqa: PLC0415

    if chosen["envelope_band_hz"] and no_envelope:
        raise ValueError("--envelope-band and --no-envelope are both given; keep one.")
    if (chosen["speed_range_hz"] is None) != (chosen["max_acceleration_hz_s"] is None):
        given, missing = "--speed-range", "--max-acceleration HZ_PER_S: how fast that speed may change"
        if chosen["speed_range_hz"] is None:
            given, missing = "--max-acceleration", "--speed-range LOW HIGH: where the reference's speed lies, in rev/s"
        raise ValueError(f"{given} is given alone; add {missing}.")
    stated = {name: value for name, value in chosen.items() if value is not None}
    return AnalysisSettings(**stated, **({"envelope_band_hz": None} if no_envelope else {}))


def _plot_orders(table: "pd.DataFrame", reference_rpm: tuple[float, float], path: Path) -> None:
    from hums.plots import save_figure, speed_order_chart  # noqa: PLC0415

    save_figure(lambda ax: speed_order_chart(table, reference_rpm=reference_rpm, ax=ax), path, width=10.0, height=7.0)
    typer.echo(f"wrote {path}", err=True)  # standard output stays what --csv and --json promise


def _reference_rpm(kinematics: "Kinematics", reference: str | None, speeds: dict[str, float] | None) -> float:
    link, frame = reference or kinematics.gearbox.reference, kinematics.gearbox.frame
    if speeds is None or link is None:
        return DRAWN_RPM
    return abs(float(kinematics.relative_speed(link, seen_from=frame, speeds=speeds)))
