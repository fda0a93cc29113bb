// Views of the report's figures: units, scales, cursors and overlays are states of the page that all figures share.
"use strict";
const report = (() => {
  const facts = JSON.parse(document.getElementById("report-facts").textContent);
  const field = (name) => document.getElementById(`tool-${name}`);
  const chosen = (name) => field(name) ? field(name).value : "";

  // One convention of units: orders, or Hz and rev/s, or CPM and rpm.
  const unit = () => {
    const name = chosen("units"), mean = facts.speed_hz.mean;
    if (name === "Hz") return {name: "Hz", factor: mean, text: `frequency at the mean speed, Hz`};
    if (name === "CPM") return {name: "CPM", factor: 60 * mean, text: `frequency at the mean speed, CPM`};
    return {name: "orders", factor: 1, text: `order, cycles per revolution of ${facts.reference}`};
  };
  const speedUnit = () => chosen("speed") === "Hz" ? {factor: 1, name: "Hz"} : {factor: 60, name: "rpm"};
  const scaled = (values, factor) => factor === 1 ? values : values.map((value) => value * factor);
  const number = (name) => Number.parseFloat(chosen(name)) || 0;

  function cursorLines(factor) {
    const lines = [], order = number("order"), spacing = number("spacing");
    if (order <= 0) return lines;
    for (let k = 1; k <= number("harmonics"); k += 1) {
      lines.push({x: k * order * factor, dash: "solid", width: k === 1 ? 1.6 : 1});
      for (let m = 1; spacing > 0 && m <= number("sidebands"); m += 1) {
        for (const side of [-m, m]) lines.push({x: (k * order + side * spacing) * factor, dash: "dot", width: 1});
      }
    }
    return lines.filter((line) => line.x > 0);
  }
  const cursorShapes = (factor) => cursorLines(factor).map((line) => ({
    type: "line", x0: line.x, x1: line.x, yref: "paper", y0: 0, y1: 1, layer: "below", name: "cursor",
    line: {color: "--watch", width: line.width, dash: line.dash}}));

  const LABEL_PX = 14;  // of one line of text, upright
  function labels(data, figure, factor, last) {
    const canvas = figure.canvas, drawn = canvas._fullLayout;
    const zoomed = drawn && drawn.xaxis && figure.state.unit === unit().name ? drawn.xaxis.range : [0, last * factor];
    const width = Math.max(200, figure.width - 90), taken = [], said = [];
    for (const line of data.lines) {
      if (!line.claimed) continue;
      const at = (line.order * factor - zoomed[0]) / (zoomed[1] - zoomed[0]) * width;
      if (at < 0 || at > width || taken.some((other) => Math.abs(other - at) < LABEL_PX)) continue;
      taken.push(at);
      said.push({x: line.order * factor, y: 1, yref: "paper", yanchor: "bottom", textangle: -90, showarrow: false,
                 text: line.label.replace("<", "&lt;"), font: {size: 11, color: line.style ? `--${line.style}` : "--faint"}});
    }
    return said;
  }

  // From so much on between smallest and largest speed, what follows the speed shows against it.
  const runUp = facts.speed_hz.max > 1.05 * facts.speed_hz.min;
  if (runUp) field("against").value = "speed";

  // On paper, unless all is asked for: of spectra, maps of a run-up and averages the first that shows a finding.
  if (location.hash === "#print") {
    document.documentElement.dataset.brief = "";
    const found = facts.findings.flatMap((row) => [row.channel, row.component]);
    const kinds = runUp ? ["orders", "envelopes", "maps", "averages"] : ["orders", "envelopes", "averages"];
    for (const section of document.querySelectorAll("main > section[aria-labelledby]")) {
      const figures = [...section.querySelectorAll("figure.plot")];
      const shows = (figure) => found.includes((figure.querySelector(".title") || {}).textContent);
      const kept = kinds.includes(section.getAttribute("aria-labelledby")) ? figures.find(shows) || figures[0] : null;
      for (const figure of figures) if (figure !== kept) figure.remove();
      if (!kept) section.remove();
    }
  }

  pages.views.spectrum = (data, figure) => {
    const {factor, name, text} = unit(), mean = facts.speed_hz.mean, scale = chosen("scale") || (data.log ? "log" : "linear");
    const db = (values) => values.map((value) => 20 * Math.log10(Math.max(value, 1e-30)));
    const y = (values) => scale === "dB" ? db(values) : values;
    const last = data.now.x[data.now.x.length - 1];
    const hover = `%{x:.6g} ${name}: %{y:.4g}<extra>%{fullData.name}</extra>`;
    const curve = (of, called, color, width) => ({type: "scatter", mode: "lines", x: scaled(of.x, factor), y: y(of.y),
      name: called, line: {color, width}, hovertemplate: hover});
    const traces = [];
    if (data.past && (!field("past") || field("past").checked)) {
      traces.push(curve(data.past, data.pastName, "--past", 0.8));
    }
    traces.push(curve(data.now, "this record", "--line", 0.8));
    const group = (called, style, lines) => lines.length && traces.push({type: "scatter", mode: "markers", name: called,
      x: lines.map((line) => line.order * factor), y: y(lines.map((line) => line.amplitude)),
      marker: {color: style, size: 6}, customdata: lines.map((line) => [line.label, line.nominal, line.snr, line.order, line.order * mean, 60 * line.order * mean]),
      hovertemplate: `%{customdata[0]}<br>order %{customdata[3]:.5g} (nominal %{customdata[1]:.5g})` +
        (mean ? `, %{customdata[4]:.5g} Hz, %{customdata[5]:.5g} CPM` : "") + `<br>%{y:.4g}, ` +
        `%{customdata[2]:.3g} times its background<extra></extra>`});
    const claimed = data.lines.filter((line) => line.claimed);
    group("identified lines", "--ink", claimed.filter((line) => !line.style));
    for (const style of ["unknown", "watch", "alarm"]) {
      group({alarm: "of diagnosed components", watch: "of indicated components", unknown: "of components not judged"}[style],
            `--${style}`, claimed.filter((line) => line.style === style));
    }
    const top = Math.max(...data.now.y), sorted = Float32Array.from(data.now.y).sort();
    const low = Math.max(sorted[Math.floor(sorted.length / 2)] / 3, top * 1e-7) || 1e-9;
    const range = {log: [Math.log10(low), Math.log10(1.3 * top || 1)], linear: [0, 1.08 * top || 1],
                   dB: [20 * Math.log10(low), 20 * Math.log10(1.3 * top || 1)]}[scale];
    const longest = Math.max(0, ...claimed.map((line) => line.label.length));
    const looked = data.lines.filter((line) => !line.claimed).map((line) => ({type: "line", name: "searched",
      x0: line.order * factor, x1: line.order * factor, yref: "paper", y0: 0, y1: 0.02, line: {color: "--faint", width: 1}}));
    const band = Math.min(250, 36 + 6.2 * longest), annotations = labels(data, figure, factor, last);
    figure.state.unit = name;
    return {traces, height: 330 + band, layout: {
      uirevision: `${name} ${scale}`, margin: {t: band, b: 84},
      xaxis: {title: {text}, range: [0, last * factor]}, annotations, shapes: [...cursorShapes(factor), ...looked],
      yaxis: {title: {text: scale === "dB" ? `dB re 1 ${data.units}` : `peak amplitude, ${data.units}`},
              type: scale === "log" ? "log" : "linear", range, exponentformat: "power"}}};
  };

  pages.views.map = (data) => {
    const {name, factor} = unit(), bySpeed = chosen("against") === "speed", rpm = speedUnit();
    const rows = data.level.length, cells = data.order.length, step = data.order[1] - data.order[0];
    let x = data.order, z = data.level, text = `order, cycles per revolution of ${facts.reference}`;
    if (name !== "orders") {  // frequencies at each row's own speed
      const per = name === "CPM" ? 60 : 1, top = data.order[cells - 1] * Math.max(...data.speed) * per;
      x = Float32Array.from({length: cells}, (_, at) => at * top / (cells - 1));
      z = data.level.map((row, at) => x.map((f) => {
        const cell = Math.round((f / (data.speed[at] * per) - data.order[0]) / step);
        return cell < cells && cell >= 0 ? row[cell] : NaN;
      }));
      text = `frequency, ${name}`;
    }
    let y = data.time, label = "time, s";
    if (bySpeed) {
      const low = Math.min(...data.speed), high = Math.max(...data.speed), bins = Math.min(60, rows);
      const width = (high - low) / bins || 1, sums = Array.from({length: bins}, () => new Float64Array(cells));
      const counts = new Array(bins).fill(0);
      z.forEach((row, at) => {
        const bin = Math.min(bins - 1, Math.floor((data.speed[at] - low) / width));
        counts[bin] += 1;
        row.forEach((value, cell) => { sums[bin][cell] += value; });
      });
      z = sums.map((row, bin) => row.map((value) => counts[bin] ? value / counts[bin] : NaN));
      y = sums.map((_, bin) => (low + (bin + 0.5) * width) * rpm.factor);
      label = `speed of ${facts.reference}, ${rpm.name}`;
    }
    return {
      traces: [{type: "heatmap", x, y, z, colorscale: "Viridis", colorbar: {title: {text: `dB re 1 ${data.units}`}, thickness: 12},
                hovertemplate: `%{x:.5g} ${name}, %{y:.5g}: %{z:.1f} dB<extra></extra>`}],
      layout: {uirevision: `${name} ${bySpeed}`, xaxis: {title: {text}}, yaxis: {title: {text: label}},
               shapes: name === "orders" ? cursorShapes(1).map((shape) => ({...shape, layer: "above"})) : []}};
  };

  pages.views.tracks = (data, figure) => {
    const against = chosen("against"), rpm = speedUnit(), colour = (place) => `--c${place % 8}`;
    const shown = (track) => track.shown ? true : "legendonly", traces = [];
    const size = (track) => track.real.map((re, at) => Math.hypot(re, track.imag[at]));
    const angle = (track) => track.real.map((re, at) => Math.atan2(track.imag[at], re) * 180 / Math.PI);
    if (against === "Nyquist") {
      data.tracks.forEach((track, place) => {
        const base = {type: "scatter", mode: "lines", legendgroup: track.name, visible: shown(track), line: {color: colour(place), width: 1.4}};
        traces.push({...base, name: track.name, x: track.real, y: track.imag,
          hovertemplate: "%{x:.4g} %{y:+.4g}j<extra>%{fullData.name}</extra>"});
        const re = mean(track.real), im = mean(track.imag), reach = 2 * mean(track.std), turn = [...Array(37).keys()];
        traces.push({...base, showlegend: false, hoverinfo: "skip", fill: "toself", opacity: 0.5,
          x: turn.map((k) => re + reach * Math.cos(k * Math.PI / 18)), y: turn.map((k) => im + reach * Math.sin(k * Math.PI / 18))});
      });
      return {traces, layout: {uirevision: "Nyquist", margin: {b: 170},
        xaxis: {title: {text: `real part, ${data.units}`}, zeroline: true, zerolinecolor: "--rule", rangemode: "tozero", scaleanchor: "y"},
        yaxis: {title: {text: `imaginary part, ${data.units}`}, zeroline: true, zerolinecolor: "--rule", rangemode: "tozero"}}};
    }
    const bySpeed = against === "speed", x = bySpeed ? scaled(data.speed, rpm.factor) : data.time;
    const order = [...x.keys()].sort((a, b) => bySpeed ? x[a] - x[b] : a - b), sorted = (values) => order.map((at) => values[at]);
    data.tracks.forEach((track, place) => {
      const a = size(track), phase = unwrapped(angle(track)), at = sorted(x);
      const spread = track.std.map((std, k) => 2 * std / Math.max(a[k], 1e-30) * 180 / Math.PI);
      const base = {type: "scatter", legendgroup: track.name, visible: shown(track)};
      for (const [values, reach, axis] of [[a, track.std.map((std) => 2 * std), "y"], [phase, spread, "y2"]]) {
        const high = sorted(values.map((value, k) => value + reach[k])), low = sorted(values.map((value, k) => value - reach[k]));
        traces.push({...base, mode: "lines", x: [...at, ...[...at].reverse()], y: [...high, ...low.reverse()], fill: "toself",
          yaxis: axis, line: {width: 0, color: colour(place)}, opacity: 0.35, showlegend: false, hoverinfo: "skip"});
        traces.push({...base, mode: bySpeed ? "markers" : "lines", x: at, y: sorted(values), yaxis: axis, name: track.name,
          showlegend: axis === "y", line: {color: colour(place), width: 1.4}, marker: {color: colour(place), size: 4},
          hovertemplate: "%{x:.5g}: %{y:.4g}<extra>%{fullData.name}</extra>"});
      }
    });
    const narrow = figure.width < 600;  // a legend in one column takes half the height
    return {traces, ...(narrow ? {height: 780} : {}), layout: {uirevision: against, margin: {b: 130},
      xaxis: {title: {text: bySpeed ? `speed of ${facts.reference}, ${rpm.name}` : "time, s"}, anchor: "y2"},
      yaxis: {title: {text: `amplitude, ${data.units}`}, domain: [0.5, 1], rangemode: "tozero"},
      yaxis2: {title: {text: "phase, degrees"}, domain: [0, 0.44]}}};
  };
  const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  const unwrapped = (degrees) => {
    let turns = 0;
    return degrees.map((value, at) => {
      if (at) turns -= Math.round((value - degrees[at - 1]) / 360);
      return value + 360 * turns;
    });
  };

  pages.views.speed = (data) => {
    const rpm = speedUnit();
    return {traces: [{type: "scatter", mode: "lines", x: data.time, y: scaled(data.speed, rpm.factor), line: {color: "--line", width: 1.2},
                      hovertemplate: `%{x:.4g} s: %{y:.6g} ${rpm.name}<extra></extra>`}],
            layout: {uirevision: rpm.name, xaxis: {title: {text: "time, s"}}, yaxis: {title: {text: `speed of ${data.shaft}, ${rpm.name}`}}}};
  };

  function readout() {
    const order = number("order"), hz = order * facts.speed_hz.mean;
    field("readout").textContent = order > 0
      ? `Cursor: order ${order.toPrecision(6)}, ${hz.toPrecision(6)} Hz, ${(60 * hz).toPrecision(6)} CPM` : "Cursor: off";
  }
  function changed(event) {
    const part = event && event.target === field("part") && facts.choices[Number(field("part").value)];
    if (part) {
      field("order").value = part.order.toFixed(5);
      field("spacing").value = part.spacing ? part.spacing.toFixed(5) : "";
    }
    readout();
    pages.redraw();
  }

  function begin() {
    document.getElementById("tools").addEventListener("change", changed);
    readout();
    pages.firstDrawn.push((figure) => {
      if (figure.spec.view !== "spectrum") return;
      figure.canvas.on("plotly_relayout", (change) => {
        if (Object.keys(change).some((key) => key.startsWith("xaxis"))) pages.draw(figure);  // labels of what is seen
      });
      figure.canvas.on("plotly_click", (event) => {
        field("order").value = (event.points[0].x / unit().factor).toFixed(5);
        changed();
      });
    });
  }
  return {begin, facts};
})();
report.begin();
