"use strict";
// The engine: members in WebAssembly. A message { to, from, count, members } moves the first members to step
// `to` with `count` saves on the way; { rows } starts again. The answer holds the saves, as far as 200 ms reach.
const FOREVER = 2 ** 40;   // steps of a run that the reader ends
const PATIENCE = 200;      // ms after which an answer holds the steps made so far, so that the page can ask for others
const PIECE = 1e5;         // steps of all members between two looks at the clock: 30 ms for an rk4 top
let engines = [], engine = null;   // one for each form of the integrator

async function whole(bytes) {
  return new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
}
async function instance(bytes, memory, stack) {
  const env = { __linear_memory: memory, __stack_pointer: new WebAssembly.Global({ value: "i32", mutable: true }, stack) };
  return (await WebAssembly.instantiate(bytes, { env })).instance.exports;
}

class Engine {
  static async load(about, { fast, exact, image, ...places }) {
    const made = new Engine();
    Object.assign(made, about, places);
    const content = await whole(image), pages = Math.ceil((about.stack + content.length) / 65536);
    made.memory = new WebAssembly.Memory({ initial: pages });
    new Uint8Array(made.memory.buffer).set(content, about.stack);
    made.view = new DataView(made.memory.buffer);
    made.kernel = await instance(await whole(fast), made.memory, about.stack).catch(() => null);
    // whether this machine fuses the relaxed multiply-add: 2^-60 is lost if the product is rounded
    const x = 1 + 2 ** -30;
    made.fused = made.kernel?.[about.fuses](x, x, -(1 + 2 ** -29)) === 2 ** -60;
    if (!made.fused) made.kernel = await instance(await whole(exact), made.memory, about.stack);
    made.write({ total: FOREVER, slots: FOREVER });
    return made;
  }
  write(fields) {
    for (const [name, value] of Object.entries(fields)) {
      const [at, kind] = this.fields[name];
      if (kind === "f8") this.view.setFloat64(this.frame + at, value, true);
      else this.view.setBigInt64(this.frame + at, BigInt(value), true);
    }
  }
  numbers(at, count) { return new Float64Array(this.memory.buffer, at, count); }
  // rows of the members at their start, and the step [s]
  begin({ rows, h }) {
    this.numbers(this.block, rows.length).set(rows);
    this.write({ h });
    this.step = 0;
  }
  // one save after the steps to `to`; a call saves at step 0 too, if it begins there
  advance(to, members) {
    const each = 8 * this.values * this.width;
    this.write({ first: this.step, last: to, stride: to, out: this.out });
    for (let low = 0; low < members; low += this.lanes) this.kernel.members(this.frame, BigInt(low), BigInt(FOREVER));
    this.step = to;
    return this.numbers(this.out + each, this.values * this.width);
  }
  // saves [count][values] of the first member at steps spread evenly up to `to`, and of all members at the last one. None
  // lies before the next step, but the start is among them. A long way ends early.
  move({ to, count, members }) {
    const from = this.step, many = Math.max(1, Math.min(count, to - from)), piece = Math.ceil(PIECE / members), end = performance.now() + PATIENCE;
    const saves = [], steps = [], save = (found, step) => { for (let i = 0; i < this.values; i++) saves.push(found[i * this.width]); steps.push(step); };
    let last;
    for (let k = 1, late = false; k <= many && !late; k++) {
      const goal = Math.round(from + (to - from) * k / many);
      do {
        const began = this.step;
        last = this.advance(Math.min(goal, began + piece), members);
        if (began === 0) save(this.numbers(this.out, this.values * this.width), 0);
        late = performance.now() >= end;
      } while (this.step < goal && !late);
      save(last, this.step);
    }
    const all = new Float64Array(this.values * members);
    for (let i = 0; i < this.values; i++) all.set(last.subarray(i * this.width, i * this.width + members), i * members);
    const status = this.numbers(this.block + 8 * this.status * this.width, members).slice();
    return { saves: Float64Array.from(saves), steps, all, status };
  }
}

self.onmessage = async ({ data }) => {
  if (data.variants) {
    try {
      engines = await Promise.all(data.variants.map(variant => Engine.load(data.about, variant)));
      self.postMessage({ ready: true, fused: engines[0].fused });
    } catch (error) {
      self.postMessage({ failed: String(error) });
    }
    return;
  }
  if (data.rows) { engine = engines[data.form]; engine.begin(data); }
  const began = performance.now(), found = engine.move(data);
  self.postMessage({ ...found, run: data.run, isLong: data.isLong, busy: performance.now() - began }, [found.saves.buffer, found.all.buffer]);
};
