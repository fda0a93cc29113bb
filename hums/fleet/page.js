// Views of the fleet's figures: courses over time, panels side by side or one below the other, lines of two records.
"use strict";
(() => {
  const DAY_MS = 86400000;
  const PANEL_PX = 150;
  const NAMED = 5;  // components in colours and in the legend; the others are thin
  const LOG_FROM = 10;  // largest index from which the axis is logarithmic, so that the limit can still be seen
  const moments = (data, days) => data.start === null ? days : Array.from(days, (day) => data.start + day * DAY_MS);
  const axis = (data) => data.start === null ? {title: {text: "record"}} : {type: "date"};

  pages.views.health = (data) => {
    const traces = data.components.map((one, at) => ({
      type: "scatter", mode: "lines", name: one.name, x: moments(data, one.x), y: one.y, showlegend: at < NAMED,
      line: {color: at < NAMED ? `--c${at}` : "--rule", width: at === 0 ? 2 : 1},
      hovertemplate: "%{x}: %{y:.3g}<extra>%{fullData.name}</extra>"}));
    traces.reverse();  // the worst on top
    traces.push({type: "scatter", mode: "lines", name: "limit", x: moments(data, data.span), y: [1, 1],
                 line: {color: "--alarm", dash: "dash", width: 1.5}, hoverinfo: "skip"});
    if (data.alarms.x.length) {
      traces.push({type: "scatter", mode: "markers", name: "alarm", x: moments(data, data.alarms.x), y: data.alarms.y,
                   text: data.alarms.text, marker: {color: "--alarm", symbol: "diamond", size: 9},
                   hovertemplate: "alarm %{x}: %{text}<extra></extra>"});
    }
    const shapes = [], layout = {xaxis: axis(data), yaxis: {title: {text: "condition index"}, rangemode: "tozero"}};
    if (data.baseline.length) {
      const [x0, x1] = moments(data, data.baseline);
      shapes.push({type: "rect", x0, x1, yref: "paper", y0: 0, y1: 1, fillcolor: "--past", opacity: 0.15, line: {width: 0},
                   layer: "below"});
      layout.annotations = [{x: x0, y: 1, yref: "paper", yanchor: "bottom", xanchor: "left", showarrow: false,
                             text: "baseline", font: {size: 11, color: "--faint"}}];
    }
    const largest = data.components.reduce((most, one) => one.y.reduce((a, b) => Math.max(a, b), most), 1);
    if (largest > LOG_FROM) layout.yaxis = {...layout.yaxis, type: "log", range: [-1, Math.log10(largest) + 0.1]};
    return {traces, layout: {...layout, shapes}};
  };

  pages.views.panels = (data, figure) => {
    const columns = figure.width > 900 ? Math.min(3, data.panels.length) : figure.width > 560 ? 2 : 1;
    const rows = Math.ceil(data.panels.length / columns), traces = [], annotations = [], shapes = [];
    const layout = {grid: {rows, columns, pattern: "independent", xgap: 0.14, ygap: 0.36}, showlegend: false,
                    margin: {l: 60, r: 16, t: 52, b: 32}};
    data.panels.forEach((panel, at) => {
      const n = at ? at + 1 : "", x = moments(data, panel.x);
      traces.push({type: "scatter", mode: "lines", x, y: panel.y, xaxis: `x${n}`, yaxis: `y${n}`, name: panel.title,
                   line: {color: "--line", width: 1}, hovertemplate: "%{x}: %{y:.4g}<extra></extra>"});
      shapes.push({type: "line", xref: `x${n} domain`, x0: 0, x1: 1, yref: `y${n}`, y0: panel.normal, y1: panel.normal,
                   line: {color: "--faint", dash: "dot", width: 1.2}});
      annotations.push({xref: `x${n} domain`, x: 0, xanchor: "left", yref: `y${n} domain`, y: 1, yanchor: "bottom",
                        showarrow: false, text: panel.title.replace(/</g, "&lt;"), font: {size: 11}});
      layout[`xaxis${n}`] = {...axis(data), title: undefined, nticks: 4};
      layout[`yaxis${n}`] = {rangemode: "tozero", nticks: 5};
    });
    return {traces, layout: {...layout, annotations, shapes}, height: PANEL_PX * rows + 70};
  };

  pages.views.stems = (data) => {
    const stem = (one, name, color, width) => {
      const x = [], y = [];
      one.x.forEach((order, at) => { x.push(order, order, null); y.push(0, one.y[at], null); });
      return {type: "scatter", mode: "lines", name, x, y, line: {color, width},
              hovertemplate: "order %{x:.5g}: %{y:.4g}<extra>%{fullData.name}</extra>"};
    };
    return {traces: [stem(data.last, data.lastName, "--c1", 3), stem(data.first, data.firstName, "--c0", 1.2)],
            layout: {xaxis: {title: {text: "order"}, rangemode: "tozero"},
                     yaxis: {title: {text: data.unit}, rangemode: "tozero"}}};
  };
})();
