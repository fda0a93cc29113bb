"use strict";
// The mechanism turns: speeds from the sliders, rates as linear forms in them, exact orders in whole numbers of any size.
const data = JSON.parse(document.getElementById("data").textContent);
const drawing = data.drawing;

// ---- exact fractions: [numerator, denominator] of BigInt, the denominator positive

const gcd = (a, b) => { while (b) [a, b] = [b, a % b]; return a < 0n ? -a : a; };
function ratio(n, d) {
  const common = gcd(n, d) || 1n, sign = d < 0n ? -1n : 1n;
  return [sign * n / common, sign * d / common];
}
const add = (a, b) => ratio(a[0] * b[1] + b[0] * a[1], a[1] * b[1]);
const times = (a, b) => ratio(a[0] * b[0], a[1] * b[1]);
const parsed = text => { const [n, d] = text.split("/"); return [BigInt(n), BigInt(d ?? 1)]; };
const written = ([n, d]) => d === 1n ? `${n}` : `${n}/${d}`;
const isExact = factors => factors.every(factor => typeof factor === "string");

/** The fraction that a decimal number is printed as. */
function decimal(number) {
  const [mantissa, exponent] = String(number).split("e");
  const [whole, part = ""] = mantissa.split(".");
  const power = part.length - Number(exponent ?? 0);
  const n = BigInt(whole + part);
  return power >= 0 ? ratio(n, 10n ** BigInt(power)) : [n * 10n ** BigInt(-power), 1n];
}

/** The value of a factor: exact ones are divided once. */
function value(factor) {
  if (typeof factor !== "string") return factor;
  const [n, d] = parsed(factor);
  return Number(n) / Number(d);
}

// ---- rates at the speeds that are set

const speeds = data.inputs.map(input => input.rpm);
const rowFactors = data.rows.map(row => row.factors.map(value));
const pairFactors = drawing.pairs.map(pair => pair.rate.map(value));
const referenceFactors = data.referenceForm.map(value);
const sum = factors => factors.reduce((total, factor, k) => total + factor * speeds[k], 0);

function exactSum(factors) {
  return factors.reduce((total, factor, k) => add(total, times(parsed(factor), decimal(speeds[k]))), [0n, 1n]);
}

/** Order and frequency of every row, speed and vector of every body, at the speeds that are set. */
function solve() {
  const reference = Math.abs(sum(referenceFactors)), exactReference = exactSum(data.referenceForm);
  const rates = {}, vectors = {[data.frame]: [0, 0, 0]};
  drawing.pairs.forEach((pair, number) => { rates[pair.body] = sum(pairFactors[number]); });
  const vector = body => {
    if (!(body in vectors)) {
      const pair = drawing.pairs.find(each => each.body === body), base = vector(pair.carried_by);
      vectors[body] = base.map((x, axis) => x + rates[body] * pair.direction[axis]);
    }
    return vectors[body];
  };
  drawing.pairs.forEach(pair => vector(pair.body));
  const rows = data.rows.map((row, number) => {
    const rpm = Math.abs(sum(rowFactors[number]));
    let exact = "";
    if (isExact(row.factors) && exactReference[0] !== 0n) {
      const order = times(exactSum(row.factors), [exactReference[1], exactReference[0]]);
      exact = written(order).replace("-", "");
    }
    return {component: row.component, kind: row.kind, hz: rpm / 60, order: reference ? rpm / reference : NaN, exact};
  });
  return {rows, rates, vectors};
}

// ---- small vectors

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const along = (a, s, b) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const unit = a => { const length = Math.hypot(...a); return a.map(x => x / length); };
const minus = (a, b) => along(a, -1, b);

/** A point turned about a line by an angle (Rodrigues). */
function turned(point, base, axis, angle) {
  const arm = minus(point, base), c = Math.cos(angle), s = Math.sin(angle), share = dot(axis, arm) * (1 - c);
  const side = cross(axis, arm);
  return base.map((x, k) => x + c * arm[k] + s * side[k] + share * axis[k]);
}

// ---- the drawing: parallel projection of all parts, the farthest first

const angles = {};
drawing.pairs.forEach(pair => { angles[pair.body] = 0; });
const declared = Object.fromEntries(data.links.map(({link, declared}) => [link, declared]));  // copies by their link
const pairOf = Object.fromEntries(drawing.pairs.map(pair => [pair.body, pair]));

/** Where a point of a body is now: turned about its own axis, then with all that carry it. */
function moved(body, point) {
  for (let pair = pairOf[body]; pair; pair = pairOf[pair.carried_by]) {
    point = turned(point, pair.point, pair.direction, angles[pair.body]);
  }
  return point;
}

const VIEWS = {
  "along the axes": () => drawing.axial,
  "from the side": () => [drawing.across, drawing.up],
  "at an angle": () => {
    const [right, up] = [drawing.across, drawing.up], out = cross(right, up);
    const a = -0.6, b = 0.45;
    const x = along(right.map(k => k * Math.cos(a)), Math.sin(a), out), z = along(out.map(k => k * Math.cos(a)), -Math.sin(a), right);
    return [x, along(up.map(k => k * Math.cos(b)), -Math.sin(b), z)];
  },
};
let [right, up] = [drawing.across, drawing.up], toward = cross(right, up), scale = 1, middle = [0, 0];
const WIDE = 720, HIGH = 540;
const flat = point => [WIDE / 2 + scale * (dot(point, right) - middle[0]), HIGH / 2 - scale * (dot(point, up) - middle[1])];

function extremes(gear) {
  const radius = gear.radius * (gear.internal ? RIM : 1.05);
  return [0, 1, 2, 3, 4, 5, 6, 7].flatMap(n => [-0.5, 0.5].map(side =>
    along(rim(gear, radius, n * Math.PI / 4), side * gear.face, gear.axis)));
}
function rim(gear, radius, angle) {
  return along(along(gear.centre, radius * Math.cos(angle), gear.e1), radius * Math.sin(angle), gear.e2);
}
function chooseView(name) {
  [right, up] = VIEWS[name]();
  toward = unit(cross(right, up));
  const points = [...drawing.gears.flatMap(extremes), ...drawing.rods.flatMap(rod => rod.points)];
  const xs = points.map(point => dot(point, right)), ys = points.map(point => dot(point, up));
  const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  middle = [(x0 + x1) / 2, (y0 + y1) / 2];
  scale = 0.92 * Math.min(WIDE / (x1 - x0 || 1), HIGH / (y1 - y0 || 1));
}
const path = points => "M" + points.map(p => `${p[0].toFixed(1)} ${p[1].toFixed(1)}`).join("L") + "Z";
const escaped = text => text.replace(/[&<>"]/g, sign => `&#${sign.charCodeAt(0)};`);

/** Points around a gear with its teeth: below and above the pitch circle by a quarter of the pitch. */
function outline(gear, radius, place, toothed) {
  const count = toothed ? 4 * gear.teeth : 64, depth = toothed ? Math.PI * radius / gear.teeth / 2 : 0;
  const points = [];
  for (let n = 0; n < count; n++) {
    const angle = gear.tooth_rad + 2 * Math.PI * (n - 0.5) / count;
    const height = toothed ? (n % 4 < 2 ? depth : -depth) * (gear.internal ? -1 : 1) : 0;
    points.push(moved(gear.body, along(rim(gear, radius + height, angle), place, gear.axis)));
  }
  return points;
}

/** The convex hull of points in the plane (Andrew 1979). */
function hull(points) {
  const sorted = points.slice().sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const turn = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
  const half = list => list.reduce((chain, point) => {
    while (chain.length > 1 && turn(chain.at(-2), chain.at(-1), point) <= 0) chain.pop();
    chain.push(point);
    return chain;
  }, []);
  return [...half(sorted).slice(0, -1), ...half(sorted.reverse()).slice(0, -1)];
}

const RIM = 1.14;  // outer radius of a ring over its pitch radius, as drawn: no drawing declares it

/** The radius of the hole in an external gear on the back of an internal one, else 0. */
function holeRadius(gear) {
  const ring = drawing.gears.find(other => other.internal && other.body === gear.body && other.radius < gear.radius);
  return ring && !gear.internal ? Math.min(RIM * ring.radius, 0.96 * gear.radius) : 0;
}

function gearShape(gear) {
  const front = dot(moved(gear.body, along(gear.centre, 1, gear.axis)), toward) > dot(moved(gear.body, gear.centre), toward) ? 1 : -1;
  const narrow = gear.radius - gear.face * Math.sin(gear.cone_rad);  // the inner end of a pitch cone
  const ends = gear.cone_rad ? [[0, gear.radius], [-gear.face * Math.cos(gear.cone_rad), narrow]] : [[gear.face / 2, gear.radius], [-gear.face / 2, gear.radius]];
  const [near, far] = front * (ends[0][0] - ends[1][0]) > 0 ? ends : ends.toReversed();
  const fill = gear.body === data.frame ? "var(--frame)" : "var(--steel)";
  const teeth = outline(gear, near[1], near[0], true).map(flat), back = outline(gear, far[1], far[0], true).map(flat);
  const flanks = teeth.map((p, n) => n % 4 === 0 ? `M${p[0].toFixed(1)} ${p[1].toFixed(1)}L${back[n][0].toFixed(1)} ${back[n][1].toFixed(1)}` : "").join("");
  const hole = holeRadius(gear);
  if (gear.internal || hole) {
    const [nearRim, farRim] = [near, far].map(([place, radius]) => outline(gear, hole || RIM * radius, place, false).map(flat));
    return `<path d="${path(farRim)}${path(back)}" fill="${fill}" fill-rule="evenodd" fill-opacity=".5" stroke="var(--faint)" stroke-width=".6"/>` +
      `<path d="${path(hull(hole ? [...teeth, ...back] : [...nearRim, ...farRim]))}" fill="none" stroke="var(--faint)" stroke-width=".8"/>` +
      `<path d="${path(nearRim)}${path(teeth)}" fill="${fill}" fill-rule="evenodd" fill-opacity=".8" stroke="var(--ink)" stroke-width=".9"/>`;
  }
  return `<path d="${path(hull([...teeth, ...back]))}" fill="${fill}" fill-opacity=".9" stroke="var(--ink)" stroke-width=".6"/>` +
    `<path d="${flanks}" stroke="var(--faint)" stroke-width=".5" fill="none"/>` +
    `<path d="${path(teeth)}" fill="${fill}" fill-opacity=".95" stroke="var(--ink)" stroke-width=".9"/>` +
    `<path d="M${flat(moved(gear.body, along(gear.centre, near[0], gear.axis))).join(" ")}L${flat(moved(gear.body, along(rim(gear, 0.8 * near[1], gear.tooth_rad), near[0], gear.axis))).join(" ")}" stroke="var(--line)" stroke-width="1.5"/>`;
}

/** The pieces of a rod, each with its depth, so that a shaft passes through its gears. */
function rodShapes(rod) {
  const ends = rod.points.map(point => moved(rod.body, point)), pieces = [];
  const axial = drawing.planar && right === drawing.axial[0];
  const wide = Math.max(1.5, 2 * scale * rod.radius * (axial ? 0.4 : 1)), count = axial ? 1 : 12;
  for (let n = 0; n + 1 < ends.length; n++) {
    for (let k = 0; k < count; k++) {
      const [start, end] = [k, k + 1].map(part => along(ends[n], part / count, minus(ends[n + 1], ends[n])));
      const [a, b] = [flat(start), flat(end)];
      const d = `M${a.map(x => x.toFixed(1)).join(" ")}L${b.map(x => x.toFixed(1)).join(" ")}`;
      pieces.push([dot(along(start, 0.5, minus(end, start)), toward),
        `<path d="${d}" stroke="var(--ink)" stroke-width="${wide + 1.2}"/>` +
        `<path d="${d}" stroke="var(--frame)" stroke-width="${wide}" stroke-linecap="${axial ? "butt" : "square"}"/>`]);
    }
  }
  return pieces;
}

const cages = {};
const cageRate = Object.fromEntries(data.rows.map((row, n) => [row.kind === "cage" ? row.component : "", n]));
function bearingShape(bearing) {
  let text = "";
  for (let n = 0; n < bearing.elements; n++) {
    const place = moved(bearing.carrier, rim(bearing, bearing.radius, 2 * Math.PI * n / bearing.elements + (cages[bearing.name] ?? 0)));
    const [x, y] = flat(place);
    text += `<circle cx="${x.toFixed(1)}" cy="${y.toFixed(1)}" r="${(scale * bearing.element_radius).toFixed(1)}" fill="var(--paper)" stroke="var(--mark)"/>`;
  }
  return text;
}

function drawMechanism() {
  const depth = point => dot(point, toward);
  const parts = [
    ...drawing.gears.map(gear => [depth(moved(gear.body, gear.centre)) - 1e-3 * gear.radius, gearShape(gear)]),
    ...drawing.rods.flatMap(rodShapes),
    ...drawing.bearings.map(bearing => [depth(moved(bearing.carrier, bearing.centre)) + 1e-2, bearingShape(bearing)]),
  ].sort((a, b) => a[0] - b[0]);
  document.getElementById("mechanism").innerHTML = parts.map(part => part[1]).join("") + gearNames();
}

/** The name of every link at one of its gears, copies once; a name goes down until it lies on no other. */
function gearNames() {
  const size = parseFloat(getComputedStyle(document.getElementById("mechanism")).fontSize), placed = [];
  const named = new Set();
  return drawing.gears.map(gear => {
    const name = declared[gear.link] ?? gear.link;
    if (named.has(name)) return "";
    named.add(name);
    const half = Math.min(0.29 * size * name.length, WIDE / 2);
    let [x, y] = flat(gear.internal ? rim(gear, 1.07 * gear.radius, Math.PI / 2) : moved(gear.body, gear.centre));
    x = Math.min(Math.max(x, half), WIDE - half);
    while (placed.some(other => Math.abs(other.y - y) < size && Math.abs(other.x - x) < half + other.half)) y += size;
    placed.push({x, y, half});
    return `<text x="${x.toFixed(1)}" y="${(y + 0.35 * size).toFixed(1)}" text-anchor="middle">${escaped(name)}</text>`;
  }).join("");
}

// ---- velocity vectors: in rows where all axes are parallel, else in the plane of the section

/** An arrow for every link and, where what carries it turns, for its motion from there; copies that agree are one. */
function velocityArrows(solved) {
  const arrows = new Map();
  const longest = Math.max(...Object.values(solved.vectors).map(vector => Math.hypot(...vector)), 1e-9);
  const share = x => Math.round(1e6 * x / longest) || 0;  // of the longest, so that rounding makes no copies differ; 0 for -0
  for (const {body, declared: name} of data.links) {
    const to = solved.vectors[body], pair = pairOf[body];
    if (!pair) continue;
    const base = solved.vectors[pair.carried_by];
    const from = declared[pair.carried_by] ?? pair.carried_by;
    const found = [{name, from: [0, 0, 0], to, relative: false}];
    if (Math.hypot(...base) > 0) found.push({name, from: base, to, relative: true});
    for (const arrow of found) {
      const key = JSON.stringify([arrow.name, arrow.relative, [...arrow.from, ...arrow.to].map(share)]);
      const copies = (arrows.get(key)?.copies ?? 0) + 1;
      const words = arrow.name + (copies > 1 ? ` (${copies})` : "") + (arrow.relative ? ` from ${from}` : "");
      arrows.set(key, {...arrow, copies, words});
    }
  }
  return [...arrows.values()];
}

const ARROWHEADS = `<defs>${["line", "mark"].map(c => `<marker id="${c}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto"><path d="M0 0L8 4L0 8Z" fill="var(--${c})"/></marker>`).join("")}</defs>`;
function arrowShape({relative}, [x0, y0], [x1, y1]) {
  const colour = relative ? "mark" : "line";
  if (Math.hypot(x1 - x0, y1 - y0) <= 1) return `<circle cx="${x1}" cy="${y1}" r="2.5" fill="var(--${colour})"/>`;
  return `<path d="M${x0} ${y0}L${x1} ${y1}" stroke="var(--${colour})" stroke-width="1.8" ${relative ? 'stroke-dasharray="5 3"' : ""} marker-end="url(#${colour})"/>`;
}
const rounded = number => String(Number(number.toPrecision(5)));

function drawVectors(solved) {
  const arrows = velocityArrows(solved), picture = document.getElementById("vectors");
  const longest = Math.max(...arrows.map(arrow => Math.max(Math.hypot(...arrow.from), Math.hypot(...arrow.to))), 1e-9);
  const [text, high] = (drawing.planar ? vectorRows : vectorPlane)(arrows, longest, parseFloat(getComputedStyle(picture).fontSize));
  picture.setAttribute("viewBox", `0 0 480 ${high}`);
  picture.innerHTML = ARROWHEADS + text;
}

/** Of parallel axes: a row for each arrow, its name and speed above it. */
function vectorRows(arrows, longest, size) {
  const axis = drawing.pairs[0].direction, step = 2.1 * size, high = step * arrows.length + size;
  const rows = arrows.map((arrow, n) => {
    const [x0, x1] = [arrow.from, arrow.to].map(vector => 240 + 225 * dot(vector, axis) / longest), y = 0.6 * size + step * n;
    return `<text x="8" y="${y + 0.6 * size}">${escaped(arrow.words)}</text>` +
      `<text x="472" y="${y + 0.6 * size}" text-anchor="end">${rounded(dot(minus(arrow.to, arrow.from), axis))}</text>` +
      arrowShape(arrow, [x0, y + 1.2 * size], [x1, y + 1.2 * size]);
  });
  return [`<path d="M240 ${0.3 * size}V${high - 0.3 * size}" stroke="var(--rule)"/>` + rows.join(""), high];
}

/** Of axes in a plane: numbered arrows from one point, those on one line side by side, and what each number is. */
function vectorPlane(arrows, longest, size) {
  const flatTo = vector => [dot(vector, drawing.across) / longest, -dot(vector, drawing.up) / longest];
  const heights = arrows.flatMap(arrow => [flatTo(arrow.from)[1], flatTo(arrow.to)[1]]);
  const top = 40 - 200 * Math.min(0, ...heights), bottom = top + 200 * Math.max(0, ...heights) + 40;
  const placed = [], lanes = {};
  const shapes = arrows.map((arrow, n) => {
    let [[x0, y0], [x1, y1]] = [arrow.from, arrow.to].map(flatTo).map(([x, y]) => [240 + 200 * x, top + 200 * y]);
    const length = Math.hypot(x1 - x0, y1 - y0);
    if (length > 1) {
      const [dx, dy] = [(x1 - x0) / length, (y1 - y0) / length], sense = dx < -1e-6 || (Math.abs(dx) < 1e-6 && dy < 0) ? -1 : 1;
      const line = [dx, dy, x0 * dy - y0 * dx].map(x => (sense * x).toFixed(2)).join(" "), lane = lanes[line] = (lanes[line] ?? 0) + 1;
      const shift = 7 * Math.floor(lane / 2) * (lane % 2 ? -1 : 1) * sense;
      [x0, x1, y0, y1] = [x0 - shift * dy, x1 - shift * dy, y0 + shift * dx, y1 + shift * dx];
    }
    const share = arrow.relative ? 0.5 : 1, beyond = arrow.relative || length <= 1 ? 0 : size / length;
    let [x, y] = [x0 + (share + beyond) * (x1 - x0) + (arrow.relative ? 0.8 * size : 0), y0 + (share + beyond) * (y1 - y0)];
    while (placed.some(other => Math.abs(other[1] - y) < size && Math.abs(other[0] - x) < 1.3 * size)) x += 1.3 * size;
    placed.push([x, y]);
    const key = bottom + 1.5 * size * (n + 0.7);
    return arrowShape(arrow, [x0, y0], [x1, y1]) +
      `<text x="${x}" y="${y + 0.35 * size}" text-anchor="middle">${n + 1}</text>` +
      `<text x="${8 + 1.4 * size}" y="${key}" text-anchor="end">${n + 1}</text><text x="${8 + 2 * size}" y="${key}">${escaped(arrow.words)}</text>` +
      `<text x="472" y="${key}" text-anchor="end">${rounded(Math.hypot(...minus(arrow.to, arrow.from)))}</text>`;
  });
  const axes = `<path d="M240 10V${bottom - 10}M10 ${top}H470" stroke="var(--rule)"/>`;
  return [axes + shapes.join(""), bottom + 1.5 * size * (arrows.length + 0.3)];
}

// ---- tables

const digits = number => Number.isFinite(number) ? String(Number(number.toPrecision(7))) : "–";
function drawTables(solved) {
  document.querySelector("#orders tbody").innerHTML = solved.rows.map((row, n) =>
    `<tr><td class="t">${escaped(row.component)}</td><td class="t">${row.kind.replaceAll("_", " ")}</td><td>${digits(row.order)}</td>` +
    `<td>${row.exact}</td><td>${digits(row.hz)}</td><td>${digits(60 * row.hz)}</td><td>${data.rows[n].sources}</td><td class="t">${escaped(data.rows[n].seen_from)}</td></tr>`).join("");
  document.querySelector("#speeds tbody").innerHTML = data.links.map(({link, body}) =>
    `<tr><td class="t">${escaped(link)}</td>${solved.vectors[body].map(x => `<td>${digits(x)}</td>`).join("")}` +
    `<td class="t">${escaped(pairOf[body]?.carried_by ?? "")}</td><td>${pairOf[body] ? digits(solved.rates[body]) : ""}</td></tr>`).join("");
}

// ---- controls and motion

let solved = solve(), playing = false, last = 0;
function refresh() {
  solved = solve();
  drawVectors(solved);
  drawTables(solved);
}
/** Set the speeds of the sliders, in rpm, and return what they make; tests read it too. */
function setSpeeds(values) {
  values.forEach((rpm, k) => {
    speeds[k] = rpm;
    for (const input of document.querySelectorAll(`[data-input="${k}"]`)) input.value = rpm;
  });
  refresh();
  return solved;
}
window.setSpeeds = setSpeeds;
for (const input of document.querySelectorAll("[data-input]")) {
  input.addEventListener("input", () => {
    const rpm = Number(input.value);
    if (input.value === "" || !Number.isFinite(rpm)) return;
    speeds[Number(input.dataset.input)] = rpm;
    for (const twin of document.querySelectorAll(`[data-input="${input.dataset.input}"]`)) if (twin !== input) twin.value = rpm;
    refresh();
  });
}

function frame(now) {
  if (!playing) return;
  const seconds = Math.min((now - last) / 1000, 0.1) / Number(slower.value) / 60;
  last = now;
  for (const body in angles) angles[body] = (angles[body] + 2 * Math.PI * solved.rates[body] * seconds) % (2 * Math.PI);
  for (const bearing of drawing.bearings) {
    const row = rowFactors[cageRate[bearing.name]];
    if (row) cages[bearing.name] = ((cages[bearing.name] ?? 0) + 2 * Math.PI * sum(row) * seconds) % (2 * Math.PI);
  }
  drawMechanism();
  requestAnimationFrame(frame);
}
const play = document.getElementById("play"), slower = document.getElementById("slower"), view = document.getElementById("view");
function turn(on) {
  playing = on;
  play.textContent = on ? "Stop" : "Play";
  play.setAttribute("aria-pressed", String(on));
  last = performance.now();
  if (on) requestAnimationFrame(frame);
}
play.addEventListener("click", () => turn(!playing));
const fastest = Math.max(...Object.values(solved.rates).map(Math.abs), 1) / 60;
const usual = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find(factor => fastest / factor <= 0.5) ?? 1000;
slower.innerHTML = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].map(n => `<option value="${n}"${n === usual ? " selected" : ""}>${n}</option>`).join("");
view.innerHTML = Object.keys(VIEWS).filter(name => drawing.planar || name !== "along the axes").map(name => `<option>${name}</option>`).join("");
view.value = drawing.planar ? "along the axes" : "at an angle";
view.addEventListener("change", () => { chooseView(view.value); drawMechanism(); });
chooseView(view.value);
refresh();
drawMechanism();
if (!matchMedia("(prefers-reduced-motion: reduce)").matches) turn(true);
