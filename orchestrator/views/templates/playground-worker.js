// Simulates cases in the program of controller_fmu/closed_loop: blocks of numbers in, outcome and curves out.
"use strict";

const EVERY = 20; // samples from one row of the motion to the next: 5 ms
const INTERVALS = 1500; // of a curve, each with its smallest and its largest value
const COLUMNS = ["q_m", "X", "q_a", "u_d", "command", "torque"]; // of the record, in their order
let program;

const numbers = (address, count) => new Float64Array(program.memory.buffer, address, count);

/** The samples that the program has recorded, as pairs one after the other. */
function record(states) {
  const view = new DataView(program.memory.buffer);
  const at = program.record.value;
  return Object.fromEntries(COLUMNS.map((name, place) => [name, numbers(view.getUint32(at + 4 * place, true), 2 * states)]));
}

function message() {
  const at = program.record.value + 4 * COLUMNS.length + 4 * 8 + 8;
  const bytes = new Uint8Array(program.memory.buffer, at, 512);
  return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0)));
}

/** The points [t, value] of a curve that a plot needs: the extremes of each interval. */
function thinned(count, time, value) {
  const points = [];
  const length = Math.max(1, Math.ceil(count / INTERVALS));
  for (let begin = 0; begin < count; begin += length) {
    let [low, high] = [begin, begin];
    for (let k = begin; k < Math.min(begin + length, count); k += 1) {
      if (value(k) < value(low)) low = k;
      if (value(k) > value(high)) high = k;
    }
    for (const k of low === high ? [low] : [Math.min(low, high), Math.max(low, high)]) points.push([time(k), value(k)]);
  }
  return points;
}

function curves(sample, states) {
  const { q_m, X, q_a, torque } = record(states);
  const time = (k) => k * sample;
  const error = (k) => 1e3 * Math.hypot(X[2 * k] - X[0], X[2 * k + 1] - X[1]);
  const motion = Array.from({ length: 5 }, () => new Float32Array(Math.ceil(states / EVERY)));
  const motors = Array.from({ length: 3 }, () => new Float32Array(motion[0].length)); // how far they have turned
  const torques = Array.from({ length: 3 }, () => new Float32Array(Math.ceil(Math.max(states - 1, 1) / EVERY)));
  for (let row = 0; row < motion[0].length; row += 1) {
    const k = row * EVERY;
    [time(k), 1e3 * (X[2 * k] - X[0]), 1e3 * (X[2 * k + 1] - X[1]), q_a[2 * k] - q_a[0], q_a[2 * k + 1] - q_a[1]].forEach(
      (value, column) => (motion[column][row] = value));
    [time(k), q_m[2 * k] - q_m[0], q_m[2 * k + 1] - q_m[1]].forEach((value, column) => (motors[column][row] = value));
    if (row < torques[0].length) [time(k), torque[2 * k], torque[2 * k + 1]].forEach((value, column) => (torques[column][row] = value));
  }
  const plots = { error: thinned(states, time, error) };
  for (const axis of [0, 1]) plots[`torque-${axis + 1}`] = thinned(states - 1, time, (k) => torque[2 * k + axis]);
  return { plots, motion, motors, torques };
}

function simulated({ block, force, forceAt, detail }) {
  const given = numbers(program.block.value, block.length);
  given.set(block);
  if (force) {
    program.force_of(...force);
    const components = numbers(program.force.value, 2);
    forceAt.forEach((place, axis) => (given[place] = components[axis]));
  }
  program.simulate_case();
  const outcome = Array.from(numbers(program.outcome.value, 20));
  const sample = block[2] / block[3];
  const states = Math.round(outcome[2] / sample) + 1;
  const started = outcome[0] !== 5;
  return {
    outcome: outcome.map((value) => (Number.isNaN(value) ? null : value)),
    message: message(),
    ...(detail === "curves" && started ? curves(sample, states) : {}),
    ...(detail === "record" && started ? { record: Object.fromEntries(Object.entries(record(states)).map(([name, column]) => [name, column.slice()])) } : {}),
  };
}

onmessage = ({ data }) => {
  if (data.module) {
    program = new WebAssembly.Instance(data.module, {}).exports;
    program._initialize();
  } else postMessage({ number: data.number, ...simulated(data) });
};
