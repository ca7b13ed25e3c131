// ---- charts --------------------------------------------------------------------------------

function ticks(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * ([1, 2, 5, 10].find(s => s * power >= raw));
  const list = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) list.push(k * step);
  return list.length > 2 || count > 16 ? list : ticks(low, high, 2 * count);
}
// the ends of an axis; of values that differ by less than a part of themselves, such as by rounding, wider ones
function widened(low, high, part) {
  if (!isFinite(low)) return [0, 1];
  const more = low ? 0.1 * Math.abs(low) : 1;
  return high - low > part * Math.max(Math.abs(low), Math.abs(high), 1e-12) ? [low, high] : [low - more, high + more];
}
const nice = x => x === 0 ? "0" : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3
  ? (+x.toPrecision(6)).toExponential().replace("e+", "e") : String(+x.toPrecision(6));

const COLOURS = ["--one", "--two", "--three"], DASHES = [[], [7, 3], [2, 3]];
function legend(id, names) {
  $(id).replaceChildren(...names.map((name, k) => html("b", { style: `color:var(${COLOURS[k]})` }, `${["—", "–\u00a0–", "···"][k]}\u00a0${name}`)));
}
class Chart extends Canvas {
  constructor(node) {
    super(node);
    const point = event => {
      const { left, top } = node.getBoundingClientRect();
      this.pointer = event && [event.clientX - left, event.clientY - top];
      if (this.drawn) this.draw(this.drawn);
    };
    node.addEventListener("pointermove", point);
    for (const end of ["pointerleave", "pointercancel"]) node.addEventListener(end, () => point(null));
  }
  // series: [{x, y, name}] of equal lengths; with marks: circles in place of a line; tone: its colour, by default its place; log: y are exponents of 10; dots: one at the end of a curve in the plane
  draw(drawn) {
    const { series, across, upward, log = false, dots = false } = this.drawn = drawn;
    this.clear();
    const { pen, width, height } = this;
    const box = { right: width - 12, top: 10, bottom: height - 36 };
    let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const { x, y } of series) for (let i = 0; i < x.length; i++) if (isFinite(y[i])) {
      x0 = Math.min(x0, x[i]); x1 = Math.max(x1, x[i]); y0 = Math.min(y0, y[i]); y1 = Math.max(y1, y[i]);
    }
    // labels have six digits: a narrower chart would repeat them
    [y0, y1] = widened(y0, y1, 1e-5);
    if (dots) [x0, x1] = widened(x0, x1, 1e-5);
    else if (!(x1 - x0 > 1e-12 * Math.abs(x1))) [x0, x1] = isFinite(x0) ? [x0, x0 + 1] : [0, 1];
    const margin = log ? 0.5 : 0.06 * (y1 - y0);
    y0 -= margin; y1 += margin;
    Object.assign(this, { box, x0, x1, series });
    const px = x => box.left + (x - x0) / (x1 - x0) * (box.right - box.left);
    const py = y => box.bottom - (y - y0) / (y1 - y0) * (box.bottom - box.top);
    pen.font = "11px system-ui, sans-serif";
    const marks = log ? ticks(y0, y1, 4).filter(Number.isInteger) : ticks(y0, y1, 4), word = v => log ? `1e${v}` : nice(v);
    // beside the name of the axis, 21 pixels wide, and a gap of 5
    box.left = Math.max(64, 26 + Math.max(0, ...marks.map(v => pen.measureText(word(v)).width)));
    pen.fillStyle = colour("--grey"); pen.strokeStyle = colour("--rule"); pen.lineWidth = 1;
    pen.textAlign = "center"; pen.textBaseline = "top";
    for (const v of ticks(x0, x1, 6)) { pen.beginPath(); pen.moveTo(px(v), box.top); pen.lineTo(px(v), box.bottom); pen.stroke(); pen.fillText(nice(v), px(v), box.bottom + 5); }
    pen.textAlign = "right"; pen.textBaseline = "middle";
    for (const v of marks) {
      pen.beginPath(); pen.moveTo(box.left, py(v)); pen.lineTo(box.right, py(v)); pen.stroke();
      pen.fillText(word(v), box.left - 5, py(v));
    }
    pen.textAlign = "center"; pen.textBaseline = "bottom";
    pen.fillText(across, (box.left + box.right) / 2, height - 2);
    pen.save(); pen.translate(11, (box.top + box.bottom) / 2); pen.rotate(-Math.PI / 2); pen.textBaseline = "middle"; pen.fillText(upward, 0, 0); pen.restore();
    pen.save();
    pen.beginPath(); pen.rect(box.left, box.top, box.right - box.left, box.bottom - box.top); pen.clip();
    series.forEach(({ x, y, marks, tone: k }, place) => {
      k ??= place;
      pen.strokeStyle = colour(COLOURS[k % 3]); pen.setLineDash(marks ? [] : DASHES[k % 3]); pen.lineWidth = marks ? 0.8 : 1.6;
      if (marks) for (let i = 0; i < x.length; i++) { pen.beginPath(); pen.arc(px(x[i]), py(y[i]), 2.2, 0, 7); pen.stroke(); }
      if (marks) return;
      pen.beginPath();
      let open = false;
      for (let i = 0; i < x.length; i++) {
        if (!isFinite(y[i])) { open = false; continue; }
        if (open) pen.lineTo(px(x[i]), py(y[i])); else pen.moveTo(px(x[i]), py(y[i]));
        open = true;
      }
      pen.stroke();
      const i = x.length - 1;
      if (dots && i >= 0) { pen.fillStyle = colour("--path"); pen.beginPath(); pen.arc(px(x[i]), py(y[i]), 4.5, 0, 7); pen.fill(); }
    });
    pen.setLineDash([]);
    pen.restore();
    if (this.pointer) this.readOut(px, py);
  }
  // the values nearest to the pointer: at its place across, or of a curve in the plane at the nearest point
  readOut(px, py) {
    const { pen, pointer: [u, v], box, drawn: { series, log, dots, across, upward } } = this, [{ x, y }] = series;
    if (!x.length || u < box.left || u > box.right) return;
    const far = i => dots ? Math.hypot(px(x[i]) - u, py(y[i]) - v) : Math.abs(px(x[i]) - u);
    let near = 0;
    for (let i = 1; i < x.length; i++) if (far(i) < far(near)) near = i;
    const digits = value => nice(+value.toPrecision(5)), unit = words => words.replace(/^.*\[/, " [").replace(/^[^[]*$/, "");
    const lines = series.filter(s => !s.marks), named = lines.length ? lines : series;
    const values = named.map(({ y, name }) => `${name ?? upward.replace(/ ?\[.*/, "")} ${digits(log ? 10 ** y[near] : y[near])}${unit(upward).replace(/[[\]]/g, "")}`);
    const words = [`${across.replace(/ ?\[.*/, "")} ${digits(x[near])}${unit(across).replace(/[[\]]/g, "")}`, ...values].join(",  ");
    pen.strokeStyle = pen.fillStyle = colour("--ink"); pen.lineWidth = 1;
    pen.beginPath();
    if (!dots) { pen.moveTo(px(x[near]), box.top); pen.lineTo(px(x[near]), box.bottom); pen.stroke(); }
    for (const s of series) { pen.beginPath(); pen.arc(px(s.x[near]), py(s.y[near]), 3.5, 0, 7); pen.fill(); }
    pen.font = "12px system-ui, sans-serif"; pen.textAlign = "left"; pen.textBaseline = "top";
    const wide = pen.measureText(words).width, from = clamp(u - wide / 2, box.left, Math.max(box.left, box.right - wide));
    pen.fillStyle = colour("--paper"); pen.globalAlpha = 0.85; pen.fillRect(from - 3, box.top, wide + 6, 17); pen.globalAlpha = 1;
    pen.fillStyle = colour("--ink"); pen.fillText(words, from, box.top + 2);
  }
  // a line at time t, in an element of its own, whose motion repaints nothing
  cursor(t) {
    const { left, right, top, bottom } = this.box, line = this.node.nextElementSibling.style;
    line.top = `${this.node.offsetTop + top}px`; line.height = `${bottom - top}px`;
    line.transform = `translateX(${(left + (t - this.x0) / (this.x1 - this.x0) * (right - left)).toFixed(1)}px)`;
  }
  onPick(seek) {
    const pick = event => {
      const { left, right } = this.box, x = event.clientX - this.node.getBoundingClientRect().left;
      seek(this.x0 + (this.x1 - this.x0) * clamp((x - left) / (right - left), 0, 1));
    };
    this.node.addEventListener("pointerdown", event => { this.node.setPointerCapture(event.pointerId); pick(event); });
    this.node.addEventListener("pointermove", event => { if (event.buttons) pick(event); });
  }
}
