// Draws the figures of a page with plotly.js: when they come into sight, in the colours of light, dark or print. The
// library, 1.5 MB, is run by the first figure that is drawn, once text and tables stand on the screen.
"use strict";
const pages = (() => {
  const PRINT_WIDTH = 680;  // CSS pixels of 180 mm, between the margins of A4
  const PRINT_HEIGHT = 0.78;  // of that on the screen, so that two figures share a sheet
  const figures = new Map();
  const views = {};  // name -> (data, figure) => ({traces, layout})
  const firstDrawn = [];  // called once with each figure, to listen to its events

  function decode(value) {
    if (Array.isArray(value)) return value.map(decode);
    if (value === null || typeof value !== "object") return value;
    if (!("bdata" in value)) return Object.fromEntries(Object.entries(value).map(([key, v]) => [key, decode(v)]));
    const bytes = Uint8Array.from(atob(value.bdata), (c) => c.charCodeAt(0));
    let numbers = new ({f4: Float32Array, u1: Uint8Array, u2: Uint16Array}[value.dtype])(bytes.buffer);
    const none = value.dtype === "u1" ? 255 : 65535;
    if ("step" in value) numbers = Float32Array.from(numbers, (code) => code === none ? NaN : value.low + code * value.step);
    if (value.shape.length === 1) return numbers;
    const [rows, columns] = value.shape;
    return Array.from({length: rows}, (_, row) => numbers.subarray(row * columns, (row + 1) * columns));
  }

  function themed(value, style) {
    if (typeof value === "string") return value.startsWith("--") ? style.getPropertyValue(value).trim() : value;
    if (Array.isArray(value)) return value.map((each) => themed(each, style));
    if (value === null || typeof value !== "object" || ArrayBuffer.isView(value)) return value;
    return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, themed(each, style)]));
  }

  const merge = (below, above) => {
    const result = {...below};
    for (const [key, value] of Object.entries(above || {})) {
      const both = value && typeof value === "object" && !Array.isArray(value) && !ArrayBuffer.isView(value);
      result[key] = both ? merge(result[key] || {}, value) : value;
    }
    return result;
  };

  const AXIS = {gridcolor: "--rule", linecolor: "--faint", zerolinecolor: "--rule", automargin: true, showline: true,
                ticks: "outside", tickcolor: "--faint", title: {standoff: 8}};
  const LAYOUT = {paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", uirevision: "kept",
                  font: {family: "system-ui, DejaVu Sans, sans-serif", size: 12, color: "--ink"},
                  margin: {l: 60, r: 16, t: 30, b: 48}, hovermode: "closest", dragmode: "zoom",
                  hoverlabel: {bgcolor: "--panel", bordercolor: "--rule", font: {color: "--ink"}},
                  legend: {orientation: "h", yref: "container", y: 0, yanchor: "bottom", x: 0, font: {size: 11}},
                  modebar: {bgcolor: "rgba(0,0,0,0)", color: "--faint", activecolor: "--ink"}};
  const CONFIG = {displaylogo: false, responsive: false, toImageButtonOptions: {format: "svg"},
                  showSendToCloud: false,  // no data leaves the page
                  modeBarButtonsToRemove: ["select2d", "lasso2d"]};

  function loadLibrary() {
    const source = document.getElementById("plotly");
    if (!source) return;
    const script = document.createElement("script");
    script.textContent = source.textContent;
    source.replaceWith(script);
  }

  function draw(figure) {
    if (!figure.spec) {
      figure.spec = decode(JSON.parse(figure.source.textContent));
      figure.source.remove();
    }
    const spec = figure.spec, printing = document.documentElement.dataset.theme === "print";
    if (!printing && !figure.canvas.clientWidth) {  // out of sight: drawn when it comes into view
      figure.drawn = false;
      return null;
    }
    loadLibrary();
    figure.width = printing ? PRINT_WIDTH : figure.canvas.clientWidth;
    const seen = spec.view ? views[spec.view](spec.data, figure) : spec;
    let layout = merge(LAYOUT, merge(spec.layout, seen.layout));
    for (const key of Object.keys(layout).filter((name) => /^[xy]axis\d*$/.test(name))) {
      layout[key] = merge(AXIS, layout[key]);
    }
    const traces = printing ? seen.traces.filter((trace) => trace.visible !== "legendonly") : seen.traces;
    const width = figure.width;
    if (width < 600) layout.margin = {...layout.margin, l: Math.min(layout.margin.l, 48), r: 8};
    const height = Math.round((seen.height || figure.height) * (printing ? PRINT_HEIGHT : 1));
    figure.canvas.style.height = `${height}px`;
    layout = {...layout, width, height};
    const style = getComputedStyle(document.documentElement);
    const ready = Plotly.react(figure.canvas, themed(traces, style), themed(layout, style), CONFIG);
    figure.drawn = true;
    if (!figure.heard) {
      figure.heard = true;
      for (const listen of firstDrawn) listen(figure);
    }
    for (const svg of figure.canvas.querySelectorAll("svg.main-svg")) svg.setAttribute("aria-hidden", "true");
    const first = figure.canvas.querySelector("svg.main-svg");
    if (first) {
      first.removeAttribute("aria-hidden");
      first.setAttribute("role", "img");
      first.setAttribute("aria-label", spec.alt);
    }
    return ready;
  }

  const drawAll = () => Promise.all([...figures.values()].map(draw));
  const redraw = () => [...figures.values()].filter((figure) => figure.drawn).map(draw);

  function keys(figure, event) {
    if (event.target !== figure.canvas || event.ctrlKey || event.metaKey || event.altKey) return;
    const axes = figure.canvas._fullLayout;
    if (!axes || !axes.xaxis) return;
    const change = {};
    for (const [axis, less, more] of [["xaxis", "ArrowLeft", "ArrowRight"], ["yaxis", "ArrowDown", "ArrowUp"]]) {
      const [low, high] = axes[axis].range, span = high - low;
      const move = event.key === less ? -0.2 : event.key === more ? 0.2 : 0;
      if (move) change[`${axis}.range`] = [low + move * span, high + move * span];
      if (axis === "xaxis" && "+-".includes(event.key)) {
        const by = event.key === "+" ? 0.25 : -0.5;
        change["xaxis.range"] = [low + by * span, high - by * span];
      }
      if (event.key === "0") change[`${axis}.autorange`] = true;
    }
    if (Object.keys(change).length) {
      event.preventDefault();
      Plotly.relayout(figure.canvas, change);
    }
  }

  function print() {
    document.documentElement.dataset.theme = "print";
    return drawAll();
  }

  function begin() {
    const watch = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        const figure = figures.get(entry.target.parentElement.id);
        if (entry.isIntersecting && !figure.drawn) draw(figure);
      }
    }, {rootMargin: "300px"});
    for (const element of document.querySelectorAll("figure.plot")) {
      const [canvas, source] = [element.querySelector(".canvas"), element.querySelector("script")];
      const figure = {name: element.id, element, canvas, source, state: {}, drawn: false,
                      height: Number.parseInt(canvas.style.height, 10)};
      figures.set(element.id, figure);
      canvas.addEventListener("keydown", (event) => keys(figure, event));
    }
    addEventListener("load", () => requestIdleCallback(() => {
      for (const figure of figures.values()) {
        const {top, height} = figure.canvas.getBoundingClientRect();
        if (height && top < innerHeight) draw(figure);  // needs no frame, which a browser without a screen may not give
        else watch.observe(figure.canvas);
      }
      requestIdleCallback(loadLibrary);  // so that figures further down are drawn at once
    }, {timeout: 500}));
    let width = innerWidth;
    addEventListener("resize", () => { if (innerWidth !== width) { width = innerWidth; redraw(); } });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
    addEventListener("beforeprint", print);
    addEventListener("afterprint", () => { delete document.documentElement.dataset.theme; redraw(); });
    if (location.hash.startsWith("#print")) print();
  }

  return {figures, views, firstDrawn, draw, drawAll, redraw, begin};
})();
