// Views of the report's figures, which share units, scales, cursors and overlays.
"use strict";
const report = (() => {
  const facts = JSON.parse(document.getElementById("report-facts").textContent);
  const field = (name) => document.getElementById(`tool-${name}`);
  const chosen = (name) => field(name) ? field(name).value : "";


  const unit = () => {
    const name = chosen("units"), mean = facts.speed_hz.mean;
    if (name === "Hz") return {name: "Hz", factor: mean, text: `frequency at the mean speed, Hz`};
    if (name === "CPM") return {name: "CPM", factor: 60 * mean, text: `frequency at the mean speed, CPM`};
    return {name: "orders", factor: 1, text: `order, cycles per revolution of ${facts.reference}`};
  };
  const speedUnit = () => chosen("speed") === "Hz" ? {factor: 1, name: "Hz"} : {factor: 60, name: "rpm"};
  const scaled = (values, factor) => factor === 1 ? values : values.map((value) => value * factor);
  const number = (name) => Number.parseFloat(chosen(name)) || 0;

  // Amplitudes are kept as peak values.
  const MEASURES = {"peak": 1, "RMS": Math.SQRT1_2, "peak-to-peak": 2};
  const measure = () => ({name: chosen("measure"), factor: MEASURES[chosen("measure")]});

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
      const at = (line.order * factor - zoomed[0]) / (zoomed[1] - zoomed[0]) * width;
      if (at < 0 || at > width || taken.some((other) => Math.abs(other - at) < LABEL_PX)) continue;
      taken.push(at);
      said.push({x: line.order * factor, y: 1, yref: "paper", yanchor: "bottom", textangle: -90, showarrow: false,
                 text: line.label.replace("<", "&lt;"), font: {size: printing() ? 8 : 11, color: line.style ? `--${line.style}` : "--faint"}});
    }
    return said;
  }

  // A run-up is shown against speed.
  const runUp = facts.speed_hz.max > 1.05 * facts.speed_hz.min;
  if (runUp) field("against").value = "speed";

  // A tab for each sensor; content of no single sensor stays visible. On paper all are shown.
  const tabs = [...document.querySelectorAll("[role=tab]")];
  function select(tab) {
    for (const one of tabs) {
      one.setAttribute("aria-selected", one === tab);
      one.tabIndex = one === tab ? 0 : -1;
    }
    for (const element of document.querySelectorAll("[data-channel]:not([role=tab])")) {
      element.classList.toggle("off", !["", tab.dataset.channel].includes(element.dataset.channel));
    }
    document.getElementById("panel").setAttribute("aria-labelledby", tab.id);
  }
  tabs.forEach((tab, place) => {
    tab.addEventListener("click", () => select(tab));
    tab.addEventListener("keydown", (event) => {
      const step = {ArrowLeft: -1, ArrowRight: 1}[event.key];
      if (!step) return;
      const next = tabs[(place + step + tabs.length) % tabs.length];
      select(next);
      next.focus();
    });
  });
  if (tabs.length) select(tabs.find((tab) => facts.findings.some((row) => row.channel === tab.dataset.channel)) || tabs[0]);

  const openAll = () => { for (const details of document.querySelectorAll("details")) details.open = true; };
  addEventListener("beforeprint", openAll);
  if (location.hash.startsWith("#print")) openAll();
  // A link into collapsed details opens them.
  const unfold = () => {
    const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    const details = target && (target.closest("details") || target.querySelector("details"));
    if (details) details.open = true;
  };
  addEventListener("hashchange", unfold);
  unfold();

  // The summary on paper keeps the first figure that shows a finding of spectra, maps of run-ups, and averages, if any.
  if (location.hash === "#print") {
    document.documentElement.dataset.brief = "";
    const found = facts.findings.flatMap((row) => [row.channel, row.component]);
    const kinds = runUp ? ["orders", "envelopes", "maps", "averages"] : ["orders", "envelopes", "averages"];
    for (const section of document.querySelectorAll("#panel > section")) {
      const figures = [...section.querySelectorAll("figure.plot")];
      const shows = (figure) => found.includes((figure.querySelector(".title") || {}).textContent);
      const kind = section.getAttribute("aria-labelledby"), any = kind === "averages" ? null : figures[0];
      const kept = kinds.includes(kind) ? figures.find(shows) || any : null;
      for (const figure of figures) if (figure !== kept) figure.remove();
      if (!kept) section.remove();
    }
  }

  const printing = () => document.documentElement.dataset.theme === "print";  // where two figures share a sheet
  const amplitudes = (levels) => levels.map((level) => 10 ** level);
  pages.views.spectrum = (data, figure) => {
    const [now, past] = [data.now, data.past].map((of) => of && {x: of.x, y: amplitudes(of.level)});
    const {factor, name, text} = unit(), mean = facts.speed_hz.mean, scale = chosen("scale") || (data.log ? "log" : "linear");
    const shown = measure(), db = (values) => values.map((value) => 20 * Math.log10(Math.max(value, 1e-30)));
    const y = (values) => scale === "dB" ? db(scaled(values, shown.factor)) : scaled(values, shown.factor);
    const last = now.x[now.x.length - 1];
    const hover = `%{x:.6g} ${name}: %{y:.4g}<extra>%{fullData.name}</extra>`;
    const curve = (of, called, color, width) => ({type: "scatter", mode: "lines", x: scaled(of.x, factor), y: y(of.y),
      name: called, line: {color, width}, hovertemplate: hover});
    const traces = [];
    if (past && (!field("past") || field("past").checked)) {
      traces.push(curve(past, data.pastName, "--past", 0.8));
    }
    traces.push(curve(now, "this record", "--line", 0.8));
    const group = (called, style, lines) => lines.length && traces.push({type: "scatter", mode: "markers", name: called,
      x: lines.map((line) => line.order * factor), y: y(lines.map((line) => line.amplitude)),
      marker: {color: style, size: 6}, customdata: lines.map((line) => [line.label, line.nominal, line.snr, line.order, line.order * mean, 60 * line.order * mean]),
      hovertemplate: `%{customdata[0]}<br>order %{customdata[3]:.5g} (nominal %{customdata[1]:.5g})` +
        (mean ? `, %{customdata[4]:.5g} Hz, %{customdata[5]:.5g} CPM` : "") + `<br>%{y:.4g}, ` +
        `%{customdata[2]:.3g} times its background<extra></extra>`});
    group("identified lines", "--ink", data.lines.filter((line) => !line.style));
    for (const style of ["unknown", "watch", "alarm"]) {
      group({alarm: "diagnosed components", watch: "indicated components", unknown: "components not judged"}[style],
            `--${style}`, data.lines.filter((line) => line.style === style));
    }
    const sorted = Float32Array.from(scaled(now.y, shown.factor)).sort(), top = sorted[sorted.length - 1];
    const low = Math.max(sorted[Math.floor(sorted.length / 2)] / 3, top * 1e-7) || 1e-9;
    const range = {log: [Math.log10(low), Math.log10(1.3 * top || 1)], linear: [0, 1.08 * top || 1],
                   dB: [20 * Math.log10(low), 20 * Math.log10(1.3 * top || 1)]}[scale];
    const looked = Array.from(data.searched, (order) => ({type: "line", name: "searched",
      x0: order * factor, x1: order * factor, yref: "paper", y0: 0, y1: 0.02, line: {color: "--faint", width: 1}}));
    const annotations = labels(data, figure, factor, last);
    const longest = Math.max(0, ...annotations.map((label) => label.text.length));
    const band = printing() ? Math.min(210, 30 + 4.7 * longest) : Math.min(250, 36 + 6.2 * longest);
    figure.state.unit = name;
    return {traces, height: printing() ? Math.min(500, 320 + band) : 410 + band, layout: {
      uirevision: `${name} ${scale} ${shown.name}`, margin: {t: band, b: 84},
      xaxis: {title: {text}, range: [0, last * factor]}, annotations, shapes: [...cursorShapes(factor), ...looked],
      yaxis: {title: {text: scale === "dB" ? `dB re 1 ${data.units}` : `${shown.name} amplitude, ${data.units}`},
              type: scale === "log" ? "log" : "linear", range, exponentformat: "power"}}};
  };

  // The whole band of the sensor, always against frequency.
  pages.views.wideband = (data) => {
    const {name, factor} = measure(), scale = chosen("scale") || "log";
    const amplitude = amplitudes(data.level), y = amplitude.map((value) => scale === "dB" ? 20 * Math.log10(Math.max(factor * value, 1e-30)) : factor * value);
    const [least, top] = [Math.min, Math.max].map((pick) => factor * amplitude.reduce((a, b) => pick(a, b)));
    const low = Math.max(least / 1.3, top * 1e-5, 1e-12);
    const range = {log: [Math.log10(low), Math.log10(1.3 * top || 1)], linear: [0, 1.08 * top || 1],
                   dB: [20 * Math.log10(low), 20 * Math.log10(1.3 * top || 1)]}[scale];
    return {traces: [{type: "scatter", mode: "lines", x0: 0, dx: data.step, y, line: {color: "--line", width: 0.8},
                      hovertemplate: "%{x:.6g} Hz: %{y:.4g}<extra></extra>"}],
            layout: {uirevision: `${name} ${scale}`,
                     xaxis: {title: {text: "frequency, Hz"}, range: [0, data.step * (y.length - 1)]},
                     yaxis: {title: {text: scale === "dB" ? `dB re 1 ${data.units}` : `${name} amplitude, ${data.units}`},
                             type: scale === "log" ? "log" : "linear", range, exponentformat: "power"}}};
  };

  pages.views.map = (data) => {
    const {name, factor} = unit(), bySpeed = chosen("against") === "speed", rpm = speedUnit();
    const rows = data.level.length, cells = data.order.length, step = data.order[1] - data.order[0];
    const shown = measure(), gain = 20 * Math.log10(shown.factor);
    let x = data.order, z = data.level, text = `order, cycles per revolution of ${facts.reference}`;
    if (name !== "orders") {  // frequencies at each row's own speed
      const per = name === "CPM" ? 60 : 1, top = data.order[cells - 1] * Math.max(...data.speed) * per;
      x = Float32Array.from({length: cells}, (_, at) => at * top / (cells - 1));
      const half = x[1] / 2;
      z = data.level.map((row, at) => x.map((f) => {  // the largest of the orders in each cell, so that no line is lost
        const [first, last] = [f - half, f + half].map((edge) => Math.round((edge / (data.speed[at] * per) - data.order[0]) / step));
        return first >= cells ? NaN : row.subarray(Math.max(first, 0), Math.max(last, 0) + 1).reduce((a, b) => Math.max(a, b), -Infinity);
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
      const filled = [...counts.keys()].filter((bin) => counts[bin]);
      z = sums.map((_, bin) => {  // an empty bin takes its nearest neighbour
        const at = filled.reduce((best, other) => Math.abs(other - bin) < Math.abs(best - bin) ? other : best);
        return sums[at].map((value) => value / counts[at]);
      });
      y = sums.map((_, bin) => (low + (bin + 0.5) * width) * rpm.factor);
      label = `speed of ${facts.reference}, ${rpm.name}`;
    }
    z = z.map((row) => row.map((value) => value + gain));
    return {
      ...(printing() ? {height: 380} : {}),
      traces: [{type: "heatmap", x, y, z, colorscale: "Viridis", colorbar: {title: {text: `dB re 1 ${data.units} ${shown.name}`, side: "right"}, thickness: 12},
                hovertemplate: `%{x:.5g} ${name}, %{y:.5g} ${bySpeed ? rpm.name : "s"}: %{z:.1f} dB<extra></extra>`}],
      layout: {uirevision: `${name} ${bySpeed}`, xaxis: {title: {text}}, yaxis: {title: {text: label}},
               shapes: name === "orders" ? cursorShapes(1).map((shape) => ({...shape, layer: "above"})) : []}};
  };

  pages.views.tracks = (data, figure) => {
    const against = chosen("against"), rpm = speedUnit(), kind = measure(), colour = (track) => `--c${track.colour % 8}`;
    const dash = (track) => ["solid", "dash", "dot"][Math.floor(track.colour / 8) % 3];
    const SHOWN = 4, traces = [];  // the legend shows the others
    const size = (track) => track.real.map((re, at) => Math.hypot(re, track.imag[at]));
    const angle = (track) => track.real.map((re, at) => Math.atan2(track.imag[at], re) * 180 / Math.PI);
    if (against === "Nyquist") {
      data.tracks.forEach((kept, place) => {
        const visible = place < SHOWN ? true : "legendonly";
        const track = {...kept, ...Object.fromEntries(["real", "imag", "halfWidth"].map((part) => [part, scaled(kept[part], kind.factor)]))};
        const base = {type: "scatter", mode: "lines", legendgroup: track.name, visible, line: {color: colour(track), width: 1.4, dash: dash(track)}};
        traces.push({...base, name: track.name, x: track.real, y: track.imag,
          hovertemplate: "%{x:.4g} %{y:+.4g}j<extra>%{fullData.name}</extra>"});
        const re = mean(track.real), im = mean(track.imag), reach = mean(track.halfWidth), turn = [...Array(37).keys()];
        traces.push({...base, showlegend: false, hoverinfo: "skip", fill: "toself", opacity: 0.5,
          x: turn.map((k) => re + reach * Math.cos(k * Math.PI / 18)), y: turn.map((k) => im + reach * Math.sin(k * Math.PI / 18))});
      });
      return {traces, layout: {uirevision: `Nyquist ${kind.name}`, margin: {b: 170},
        xaxis: {title: {text: `real part, ${kind.name}, ${data.units}`}, zeroline: true, zerolinecolor: "--rule", rangemode: "tozero", scaleanchor: "y"},
        yaxis: {title: {text: `imaginary part, ${kind.name}, ${data.units}`}, zeroline: true, zerolinecolor: "--rule", rangemode: "tozero"}}};
    }
    const bySpeed = against === "speed", x = bySpeed ? scaled(data.speed, rpm.factor) : data.time;
    const order = [...x.keys()].sort((a, b) => bySpeed ? x[a] - x[b] : a - b), sorted = (values) => order.map((at) => values[at]);
    data.tracks.forEach((kept, place) => {
      const visible = place < SHOWN ? true : "legendonly";
      const track = {...kept, ...Object.fromEntries(["real", "imag", "halfWidth"].map((part) => [part, scaled(kept[part], kind.factor)]))};
      const a = size(track), phase = unwrapped(angle(track)), at = sorted(x);
      const spread = track.halfWidth.map((half, k) => Math.min(half / Math.max(a[k], 1e-30), Math.PI) * 180 / Math.PI);
      const base = {type: "scatter", legendgroup: track.name, visible};
      for (const [values, reach, axis] of [[a, track.halfWidth, "y"], [phase, spread, "y2"]]) {
        const high = sorted(values.map((value, k) => value + reach[k])), low = sorted(values.map((value, k) => value - reach[k]));
        traces.push({...base, mode: "lines", x: [...at, ...[...at].reverse()], y: [...high, ...low.reverse()], fill: "toself",
          yaxis: axis, line: {width: 0, color: colour(track)}, opacity: 0.35, showlegend: false, hoverinfo: "skip"});
        traces.push({...base, mode: bySpeed ? "markers" : "lines", x: at, y: sorted(values), yaxis: axis, name: track.name,
          showlegend: axis === "y", line: {color: colour(track), width: 1.4, dash: dash(track)}, marker: {color: colour(track), size: 4},
          hovertemplate: "%{x:.5g}: %{y:.4g}<extra>%{fullData.name}</extra>"});
      }
    });
    const narrow = figure.width < 600;  // a legend in one column takes half the height
    const rows = Math.ceil(data.tracks.length / (narrow ? 1 : 3));
    return {traces, height: 460 + 20 * rows, layout: {uirevision: `${against} ${kind.name}`, margin: {b: 100},
      xaxis: {title: {text: bySpeed ? `speed of ${facts.reference}, ${rpm.name}` : "time, s"}, anchor: "y2"},
      yaxis: {title: {text: `${kind.name} amplitude, ${data.units}`}, domain: [0.5, 1], rangemode: "tozero"},
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

  // Tooth k lies between k - 1/2 and k + 1/2; the average starts with tooth 1.
  pages.views.average = (data, figure) => {
    const first = 0.5, last = data.teeth + 0.5, narrow = figure.width < 600, TICKS = narrow ? 8 : 25, every = Math.ceil(data.teeth / TICKS);
    const curve = (y, yaxis) => ({type: "scatter", mode: "lines", x0: first, dx: data.teeth / y.length, y, yaxis, showlegend: false,
      line: {color: "--line", width: 1.2}, hovertemplate: "tooth %{x:.2f}: %{y:.4g}<extra></extra>"});
    return {traces: [curve(data.average, "y"), curve(data.difference, "y2")],
            layout: {xaxis: {title: {text: narrow ? "tooth" : "tooth, counted from the start of the average"}, range: [first, last], tick0: 1,
                             dtick: every, anchor: "y2", showgrid: false},
                     yaxis: {title: {text: `average, ${data.units}`}, domain: [0.55, 1]},
                     yaxis2: {title: {text: `difference, ${data.units}`}, domain: [0, 0.45]}}};
  };

  pages.views.kurtogram = (data) => {
    const cells = data.kurtosis[0].length;
    const shapes = data.band ? [{type: "rect", x0: data.band[0], x1: data.band[1], yref: "paper", y0: 0, y1: 1,
      line: {color: "--alarm", width: 2}, label: {text: "demodulation band", textposition: "top center", font: {color: "#ffffff"}}}] : [];
    const y = data.levels.map((level) => Math.round(data.half / 2 ** level).toLocaleString("en"));
    return {traces: [{type: "heatmap", z: data.kurtosis, x0: data.half / cells / 2, dx: data.half / cells, y, colorscale: "Viridis",
                      colorbar: {title: {text: "kurtosis"}, thickness: 12}, hovertemplate: "%{x:.5g} Hz, bandwidth %{y} Hz: %{z:.3g}<extra></extra>"}],
            layout: {xaxis: {title: {text: "frequency, Hz"}, range: [0, data.half]}, shapes,
                     yaxis: {title: {text: "bandwidth, Hz"}, type: "category", autorange: "reversed"}}};
  };

  pages.views.waveform = (data) => {
    const line = {type: "scatter", mode: "lines", line: {color: "--line", width: 0.8}, showlegend: false};
    return {traces: [{...line, x0: data.first, dx: data.step, y: data.both, hovertemplate: "%{x:.4f} s: %{y:.4g}<extra></extra>"},
                     {...line, x0: data.excerptFirst, dx: data.excerptStep, y: data.excerpt, xaxis: "x2", yaxis: "y2",
                      hovertemplate: "%{x:.6g} s: %{y:.4g}<extra></extra>"}],
            layout: {xaxis: {title: {text: "time, s"}, anchor: "y"}, yaxis: {title: {text: data.units}, domain: [0.62, 1]},
                     xaxis2: {title: {text: "time, s"}, anchor: "y2"}, yaxis2: {title: {text: data.units}, domain: [0, 0.42], anchor: "x2"}}};
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
