// The playground: from what is chosen to the numbers of a case, and from a case's outcome to figures and curves.

const { units, rules: RULES, figures: FIGURES, reasons: REASONS, verdicts: VERDICTS, sizes: SIZES } = data.interface;
const single = Object.values(data.protocols)[0]; // the protocol that single cases are taken from
const unitNumber = (name) => units.findIndex((unit) => unit.name === name);
const SHOWN = { m: [1e3, "mm"], s: [1, "s"], "N.m": [1, "Nm"] };
const RADIAN = Math.PI / 180;
const MOST_FORCE = 1000; // [N] twice that of Table 1
const PLOTS = ["error", "torque-1", "torque-2"];
const DELAY_STEPS = [1, 16]; // the least and the most, of the loop's delay
const LINK_PAUSE = 400; // [ms] between changes of the address

/** Say what went wrong, and show no figures: those there are belong to something else. */
function showProblem(words) {
  $("#state").textContent = words;
  $("#results").hidden = true;
}

// Without WebAssembly or workers the rest of this script does not run, and the page would simulate for ever.
window.addEventListener("error", ({ message }) => showProblem(`The page does not work in this browser: ${message}. It needs WebAssembly and workers.`));
window.addEventListener("unhandledrejection", ({ reason }) => showProblem(`The page has failed: ${reason?.message ?? reason}.`));

// ---- The state: all that is chosen, which a link holds ----

const OWN = "own"; // in the place of a pose or a system

/** A law that is chosen: values by parameter where they are not the controller's own, or matrices. */
const law = (name, values = {}) => ({ name, values });

const BEGIN = {
  protocolCase: "c07.compliant.disturbance",
  pose: null, // link angles [degrees], if they are not the case's
  arm: null, // parameters of Table 1 by name, if they are not the case's
  force: null, // [N]
  phi: null, // its direction [rad]
  gain: null, // by axis
  delay: null, // of both torques [s]
  seed: 0, // of the noise
  chosen: law("DiagonalPID_C"),
  beside: law("RobustLQG"),
  lesson: null, // step and view of the lesson, if it is shown
};

let state = structuredClone(BEGIN);

const encoded = (value) => btoa(JSON.stringify(value)).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
const decoded = (text) => JSON.parse(atob(text.replaceAll("-", "+").replaceAll("_", "/")));

let linkProblem = ""; // what is to be said of the link that was opened

/** The state of a link, `hash`; the first one for a link of another version, or one that is none. */
function readLink(hash) {
  linkProblem = "";
  if (hash === "") return structuredClone(BEGIN);
  try {
    return stateOf(decoded(hash.slice(1)));
  } catch {
    linkProblem = "The link is damaged, or of another version of this page: this is how the page begins. ";
    return structuredClone(BEGIN);
  }
}

let [linkPause, linkIsOld] = [false, false];

/** Put the state into the address: at once, or where that was done a moment ago, at the end of the pause. Browsers refuse it
    where it happens too often, Safari more than 100 times in 30 s, and a slider that is drawn changes the state more often. */
function keepLink() {
  linkIsOld = linkPause;
  if (linkPause) return;
  history.replaceState(null, "", `#${encoded(state)}`);
  linkPause = true;
  setTimeout(() => {
    linkPause = false;
    if (linkIsOld) keepLink();
  }, LINK_PAUSE);
}

const need = (holds) => {
  if (!holds) throw new Error("no state of this page");
};
const between = (low, high) => (value) => Number.isFinite(value) && value >= low && value <= high;
const isPair = (value, holds) => Array.isArray(value) && value.length === 2 && value.every(holds);

/** A state of what a link holds, and no more than that. Whoever made the link chose it, and the command is pasted into
    a shell: text in the place of a seed would be run there. Throws an Error for anything else. */
function stateOf(given) {
  const found = Object.fromEntries(Object.entries(BEGIN).map(([key, first]) => [key, Object.hasOwn(given, key) ? given[key] : structuredClone(first)]));
  const { pose, arm, force, phi, gain, delay, seed, lesson } = found;
  const { rate } = single.imperfections;
  need(protocolCase(single, found.protocolCase));
  need(pose === null || (isPair(pose, Number.isFinite) && [data.workspace.q_a1_deg, data.workspace.q_a2_deg].every(([low, high], axis) => between(low, high)(pose[axis]))));
  need(gain === null || isPair(gain, between(0, 100)));
  // The same number as the slider's, or the command would simulate another delay than the page.
  need(delay === null || isPair(delay, (value) => Math.round(value * rate) / rate === value && between(...DELAY_STEPS)(Math.round(value * rate))));
  need(force === null || between(0, MOST_FORCE)(force));
  need(phi === null || between(-1e3, 1e3)(phi));
  need(Number.isSafeInteger(seed) && seed >= 0);
  if (arm !== null) found.arm = namedNumbers(arm, new Set(data.table.flatMap(({ symbol }) => [`${symbol}[1]`, `${symbol}[2]`])));
  for (const key of ["chosen", "beside"]) found[key] = lawOf(found[key]);
  need(lesson === null || isPair(lesson, Number.isSafeInteger));
  if (lesson) lessonState(...lesson);
  for (const one of [found.chosen, found.beside]) blockOf(found, one);
  return found;
}

function namedNumbers(given, names) {
  need(given && typeof given === "object" && Object.entries(given).every(([name, value]) => names.has(name) && Number.isFinite(value)));
  return { ...given };
}

function lawOf({ name, values, matrices }) {
  if (matrices !== undefined) {
    need(name === "linear");
    const { A, B, C, D } = matrices;
    matrixNumbers({ A, B, C, D });
    return { name, matrices: { A, B, C, D } };
  }
  const known = data.controllers.find((one) => one.name === name);
  need(known);
  return law(name, namedNumbers(values, new Set(Object.keys(units[unitNumber(known.unit)].references).filter((one) => one !== "T_s"))));
}

// ---- The noise: the seeding of NumPy's PCG64 ----

const word = (value) => value >>> 0;

/** 32-bit words of NumPy's SeedSequence for these numbers. */
function seedSequence(entropy, count) {
  const words = entropy.flatMap((number) => (number < 2 ** 32 ? [number] : [word(number % 2 ** 32), Math.floor(number / 2 ** 32)]));
  let constant = 0x43b0d7e5;
  const hashed = (value) => {
    let mixed = word(value ^ constant);
    constant = word(Math.imul(constant, 0x931e8875));
    mixed = word(Math.imul(mixed, constant));
    return word(mixed ^ (mixed >>> 16));
  };
  const mix = (x, y) => {
    const mixed = word(Math.imul(0xca01f9dd, x) - Math.imul(0x4973f715, y));
    return word(mixed ^ (mixed >>> 16));
  };
  const pool = [0, 1, 2, 3].map((place) => hashed(words[place] ?? 0));
  for (let from = 0; from < 4; from += 1) for (let to = 0; to < 4; to += 1) if (from !== to) pool[to] = mix(pool[to], hashed(pool[from]));
  for (const more of words.slice(4)) for (let to = 0; to < 4; to += 1) pool[to] = mix(pool[to], hashed(more));
  let other = 0x8b51f9dd;
  return Array.from({ length: count }, (_, place) => {
    let made = word(pool[place % 4] ^ other);
    other = word(Math.imul(other, 0x58f38ded));
    made = word(Math.imul(made, other));
    return word(made ^ (made >>> 16));
  });
}

/** State and increment of PCG64 for a seed, as the imperfections' parameters. */
function noiseOf(entropy) {
  const words = seedSequence(entropy, 8).map(BigInt);
  const wide = (place) => (words[place + 1] << 96n) | (words[place] << 64n) | (words[place + 3] << 32n) | words[place + 2];
  const mask = (1n << 128n) - 1n;
  const increment = ((wide(4) << 1n) | 1n) & mask;
  const next = (value) => (value * 0x2360ed051fc65da44385df649fccf645n + increment) & mask;
  const begin = next((increment + wide(0)) & mask);
  const split = (name, value) => [96n, 64n, 32n, 0n].map((shift, place) => [`${name}[${place + 1}]`, Number((value >> shift) & 0xffffffffn)]);
  return Object.fromEntries([...split("noise_state", begin), ...split("noise_increment", increment)]);
}

// ---- From the state to the numbers of a case ----

const protocolCase = (protocol, id) => protocol.cases.find((one) => one.id === id);

/** As Python's math.isclose with both tolerances 1e-9, by which the command finds a pose of the grid. */
const isClose = (a, b) => Math.abs(a - b) <= Math.max(1e-9 * Math.max(Math.abs(a), Math.abs(b)), 1e-9);

/** The grid's pose at these link angles [degrees], if there is one. */
const gridPose = (degrees) => data.poses.find((pose) => pose.radians.every((angle, axis) => isClose(angle, degrees[axis] * RADIAN)));

/** Whether the arm is not the case's, so that noise and disturbance are those of the system "nominal". */
const isOwn = ({ pose, arm, seed }) => pose !== null || arm !== null || seed !== 0;

/** The link angles of a state [degrees]. */
const degreesOf = (given) => given.pose ?? data.poses.find((pose) => pose.index === protocolCase(single, given.protocolCase).pose).degrees;

function valuesOf(protocol, one) {
  return {
    rules: { ...protocol.rules, ...one.rules },
    plant: { "q_a_start[1]": one.start[0], "q_a_start[2]": one.start[1], ...protocol.systems[one.system] },
    imperfections: { ...protocol.imperfections, ...one.imperfections },
  };
}

/** The numbers of a state's case; its force in polar form where it is not the case's. */
function caseOf(given) {
  const one = protocolCase(single, given.protocolCase);
  const values = valuesOf(single, one);
  const { plant, imperfections } = values;
  if (isOwn(given)) {
    const degrees = degreesOf(given);
    const pose = gridPose(degrees);
    const [first, second] = pose ? pose.radians : degrees.map((angle) => angle * RADIAN);
    Object.assign(plant, { "q_a_start[1]": first, "q_a_start[2]": second }, given.arm ?? {});
    const [, , ...more] = data.noiseWords;
    Object.assign(imperfections, noiseOf([given.seed, (pose ? pose.index : -1) + 1, ...more]));
  }
  for (const axis of [1, 2]) {
    if (given.gain) imperfections[`gain[${axis}]`] = given.gain[axis - 1];
    if (given.delay) imperfections[`drive_delay[${axis}]`] = Math.round(given.delay[axis - 1] * imperfections.rate);
  }
  const pushed = imperfections["force[1]"] !== 0 || imperfections["force[2]"] !== 0;
  const changed = isOwn(given) || given.force !== null || given.phi !== null;
  values.force = pushed && changed ? [given.force ?? single.force, given.phi ?? one.phi] : null;
  return values;
}

/** The matrices of a linear controller as numbers behind a block. Throws an Error that says what is wrong. */
function matrixNumbers({ A, B, C, D }) {
  const shaped = (name, matrix, rows, columns) => {
    const fits = Array.isArray(matrix) && matrix.length === rows && matrix.every((row) => Array.isArray(row) && row.length === columns && row.every(Number.isFinite));
    if (!fits) throw new Error(`${name} must have ${rows} × ${columns} numbers`);
  };
  if (!Array.isArray(A)) throw new Error("A, B, C and D must be lists of rows");
  const states = A.length;
  if (states > Math.max(...SIZES)) throw new Error(`at most ${Math.max(...SIZES)} states`);
  for (const [name, matrix, rows, columns] of [["A", A, states, states], ["B", B, states, 2], ["C", C, 2, states], ["D", D, 2, 2]]) shaped(name, matrix, rows, columns);
  const rows = [...A.map((row, place) => [...row, ...B[place]]), ...C.map((row, place) => [...row, ...D[place]])];
  return [states, 35, 20, ...rows.flat(), ...new Array(2 * states).fill(0)];
}

/** The block of a case for a law, and where the force stands in it. */
function blockOfValues(values, { name, values: chosenValues, matrices }) {
  const linear = matrices ? matrixNumbers(matrices) : [];
  const known = data.controllers.find((one) => one.name === name);
  const unit = matrices ? `Linear_${SIZES.find((size) => size >= linear[0])}` : known.unit;
  const parameters = matrices ? {} : { T_s: values.rules.numerator / values.rules.denominator, ...known.values, ...chosenValues };
  const block = RULES.map((rule) => values.rules[rule]);
  const forceAt = [];
  for (const [part, given] of [[data.plant, values.plant], ["Imperfections", values.imperfections], [unit, parameters]]) {
    const { references } = units[unitNumber(part)];
    block.push(unitNumber(part), Object.keys(given).length);
    for (const [variable, value] of Object.entries(given)) {
      block.push(references[variable], value);
      if (/^force\[/.test(variable)) forceAt.push(block.length - 1);
    }
  }
  block.push(...linear);
  if (!block.every(Number.isFinite)) throw new Error("a value is no number");
  return { block: Float64Array.from(block), force: values.force, forceAt };
}

const blockOf = (given, chosenLaw) => blockOfValues(caseOf(given), chosenLaw);

// ---- Workers ----

const base64Bytes = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
const module = new WebAssembly.Module(base64Bytes(data.module));
const workerAddress = URL.createObjectURL(new Blob([$("#worker").textContent], { type: "text/javascript" }));

/** A worker that answers one task after the other. */
function newWorker() {
  const worker = new Worker(workerAddress);
  worker.postMessage({ module });
  let [number, answered, failure, fail] = [0, false, null, () => {}];
  worker.onerror = (event) => {
    event.preventDefault(); // it is told where it matters, and is no error of the page
    const problem = new Error(event.message || "a worker did not start");
    if (!answered) failure = problem; // one that could not be loaded fails before its first task, and answers none
    fail(problem);
  };
  return {
    run: (task) => new Promise((resolve, reject) => {
      if (failure) throw failure;
      const wanted = (number += 1);
      fail = reject;
      worker.onmessage = ({ data: answer }) => {
        answered = true;
        if (answer.number === wanted) resolve(answer);
      };
      worker.postMessage({ ...task, number: wanted });
    }),
    end: () => worker.terminate(),
  };
}

/** The outcome by name: why and when it ended, the verdict, and the figures there are. */
function named([reason, verdict, time, until, ...values]) {
  const figures = Object.fromEntries(FIGURES.map((name, place) => [name, values[place]]).filter(([, value]) => value !== null));
  return { reason: REASONS[reason], verdict: VERDICTS[verdict], time, until, figures };
}

// ---- The figures of a case ----

const REQUIREMENT = {
  quiet: "stands still", "ring-down": "dies away", "limit cycle": "limit cycle", "left the workspace": "left the workspace", "no rest": "no rest",
};

/** A length [m] in words. */
const lengthWords = (value) => (value === undefined ? "-" : value < 1e-3 ? `${figures(1e6 * value)} µm` : `${figures(1e3 * value)} mm`);

/** The largest TCP error [m] from the begin of the force on, if the gears did not bend: as far as the motors turn. */
function shownByMotors([t, ...turned]) {
  const { imperfections } = caseOf(state);
  const rest = degreesOf(state).map((angle) => angle * RADIAN);
  const home = joints(data.links, rest).tcp;
  let most = 0;
  t.forEach((time, row) => {
    if (time < imperfections.force_start) return;
    const { tcp } = joints(data.links, rest.map((angle, axis) => angle + turned[axis][row] / data.ratios[axis]));
    most = Math.max(most, Math.hypot(tcp[0] - home[0], tcp[1] - home[1]));
  });
  return most;
}

const label = ({ name, matrices }) => (matrices ? "linear controller" : name);
const longLabel = (one) => `${label(one)}${Object.keys(one.values ?? {}).length ? " with changed gains" : ""}`;

function showFigures(answers) {
  const outcomes = answers.map(({ outcome }) => named(outcome));
  const head = element("tr", {}, element("th", { scope: "col" }, "Figure"), ...["chosen", "beside"].map((key) => element("th", { scope: "col", class: "figure" }, `${label(state[key])} (${key})`)), element("th", { scope: "col", class: "figure" }, "target"));
  $("#figures thead").replaceChildren(head);
  const cell = (value, mark) => {
    const words = { good: ["✓", "on target"], bad: ["✗", "not on target"] }[mark];
    return element("td", { class: "figure" }, value, ...(words ? [" ", element("span", { class: mark, role: "img", "aria-label": words[1] }, words[0])] : []));
  };
  const rows = Object.entries(single.criteria).filter(([name]) => outcomes.some(({ figures: values }) => name in values)).map(([name, spec]) => {
    const [factor, unit] = SHOWN[spec.unit];
    const values = outcomes.map(({ figures: { [name]: value } }) => (value === undefined ? cell("-") : cell(`${figures(factor * value)} ${unit}`, value <= spec.target ? "good" : "bad")));
    return element("tr", {}, element("th", { scope: "row" }, `${name} ${spec.title}`), ...values, cell(`${figures(factor * spec.target)} ${unit}`));
  });
  const shown = answers.map(({ motors }, which) => cell(motors && "B5" in outcomes[which].figures ? `${figures(1e3 * shownByMotors(motors))} mm` : "-"));
  if (outcomes.some(({ figures: values }) => "B5" in values)) rows.splice(rows.findIndex((row) => row.textContent.startsWith("B5")) + 1, 0, element("tr", {}, element("th", { scope: "row" }, "B5 as the motor angles show it"), ...shown, cell("-")));
  const test = single.tests[protocolCase(single, state.protocolCase).test];
  const ends = outcomes.map(({ reason, time }) => `${reason} at ${figures(time)} s`);
  if (!test.requirements.length && outcomes.some(({ reason }) => reason !== "finished"))
    rows.push(element("tr", {}, element("th", { scope: "row" }, "Its end"), ...ends.map((words) => cell(words)), cell("finished")));
  if (test.requirements.length) {
    const verdicts = outcomes.map(({ verdict }, which) => cell(REQUIREMENT[verdict] ?? ends[which], verdict === "quiet" || verdict === "ring-down" ? "good" : "bad"));
    rows.push(element("tr", {}, element("th", { scope: "row" }, `${test.requirements.join(", ")} at the end`), ...verdicts, cell("still")));
    for (const [words, name] of [["Amplitude at the end", "limit_cycle"], ["Error at the end", "rest_error"]]) {
      const values = outcomes.map(({ figures: { [name]: value } }) => cell(lengthWords(value)));
      rows.push(element("tr", {}, element("th", { scope: "row" }, words), ...values, cell(lengthWords(single.rules[name]))));
    }
  }
  $("#figures tbody").replaceChildren(...rows);
}

function showCurves(answers) {
  PLOTS.forEach((id) => {
    answers.forEach((answer, which) => {
      const name = `${label(state[["chosen", "beside"][which]])} (${["chosen", "beside"][which]})`;
      const given = data.plots[id].option;
      given.series[which].data = answer.plots?.[id] ?? [];
      given.series[which].name = name;
      given.legend.data[which].name = name;
    });
    const words = answers.map((answer, which) => `${["Chosen", "Beside"][which]}: ${peakWords(answer.plots?.[id] ?? [], id)}`);
    data.plots[id].text = `${words.join(". ")}.`;
  });
  const { imperfections, force } = caseOf(state);
  const components = force ? [force[0] * Math.cos(force[1]), force[0] * Math.sin(force[1])] : [imperfections["force[1]"], imperfections["force[2]"]];
  const rest = degreesOf(state).map((angle) => angle * RADIAN);
  const moved = answers.map((answer, which) => {
    [...(answer.motion ?? empty(5)), ...(answer.torques ?? empty(3))].forEach((column, place) => (unpacked[8 * which + place] = column));
    const numbers = (from, count) => Array.from({ length: count }, (_, place) => 8 * which + from + place);
    const window = [imperfections.force_start, imperfections.force_stop];
    return {
      name: label(state[["chosen", "beside"][which]]), rest, motion: numbers(0, 5), torque: numbers(5, 3), end: named(answer.outcome).time,
      force: components.some(Boolean) ? components : null, window, places: [["Begin", 0], ["Force", window[0]], ["After it", window[1]]],
    };
  });
  $("#results").hidden = false;
  data.motions = { motion: { choice: "which", links: data.links, circles: [["limit", single.criteria.B5.target]], circleWords: figures(1e3 * single.criteria.B5.target) + " mm", moved } };
  draw();
}

const empty = (count) => Array.from({ length: count }, () => new Float32Array(1));

function peakWords(points, id) {
  const [at, value] = points.reduce((best, point) => (Math.abs(point[1]) > Math.abs(best[1]) ? point : best), [0, 0]);
  return id === "error" ? `at most ${figures(value)} mm, at ${figures(at)} s` : `at most ${figures(Math.abs(value))} Nm, at ${figures(at)} s`;
}

// ---- Running what is chosen ----

const pair = [newWorker(), newWorker()];
let [busy, again] = [false, false];

/** Simulate both laws; while they run, only the last change is kept. */
async function update() {
  keepLink();
  showLesson();
  showCommand();
  showFormer();
  again = true;
  if (busy) return;
  busy = true;
  while (again) {
    again = false;
    $("#state").textContent = "Simulating …";
    $("#results").setAttribute("aria-busy", "true");
    const begin = performance.now();
    try {
      const answers = await Promise.all([state.chosen, state.beside].map((one, which) => pair[which].run({ ...blockOf(state, one), detail: "curves" })));
      if (again) continue;
      data.answers = answers.map(({ outcome }) => named(outcome));
      showFigures(answers);
      showSeen();
      showCurves(answers);
      const refused = answers.map(({ message }) => message).filter(Boolean);
      const told = refused.length ? refused.join(" ") : `Two cases of ${state.protocolCase}${isOwn(state) ? ", changed," : ""} in ${((performance.now() - begin) / 1000).toFixed(2)} s.`;
      $("#state").textContent = linkProblem + told;
      linkProblem = ""; // the next change is of a state of this page
    } catch (problem) {
      showProblem(`${linkProblem}Not simulated: ${problem.message}.`);
    }
  }
  busy = false;
  $("#results").setAttribute("aria-busy", "false");
}

// ---- Scorecard ----

/** As orchestrator/benchmark/scorecard.py: the cost, the criteria, and which cases of each requirement fail. */
function score(protocol, cases, outcomes) {
  const order = cases.map((one, place) => [one, outcomes[place]]).sort(([a], [b]) => a.pose - b.pose);
  const criteria = {};
  let cost = 0;
  for (const [name, spec] of Object.entries(protocol.criteria)) {
    const worst = new Map();
    for (const [one, { figures: values }] of order) {
      if (!protocol.tests[one.test].criteria.includes(name)) continue;
      const value = values[name] ?? null;
      const before = worst.get(one.pose);
      worst.set(one.pose, value === null || before === null ? null : before === undefined || value > before ? value : before);
    }
    const values = [...worst.values()];
    const value = values.includes(null) ? null : values.reduce((sum, one) => sum + one, 0) / values.length;
    criteria[name] = value;
    cost = value === null || cost === null ? null : cost + (spec.weight * value) / spec.target;
  }
  const failed = Object.fromEntries(["A1", "A2", "A3"].map((name) => [
    name,
    order.filter(([one, { verdict }]) => protocol.tests[one.test].requirements.includes(name) && !["quiet", "ring-down"].includes(verdict)).map(([one]) => one.id),
  ]));
  const broken = order.filter(([, { reason }]) => !["finished", "diverged"].includes(reason)).map(([one, outcome]) => ({ id: one.id, ...outcome }));
  return { cost, criteria, failed, broken };
}

async function evaluate(name) {
  const protocol = data.protocols[name];
  const buttons = [...document.querySelectorAll("[data-protocol]")];
  buttons.forEach((button) => (button.disabled = true));
  $("#scorecard").replaceChildren();
  const progress = $("#progress");
  progress.hidden = false;
  progress.max = protocol.cases.length;
  progress.value = 0;
  const chosenLaw = structuredClone(state.chosen);
  const begin = performance.now();
  const workers = Array.from({ length: Math.min(navigator.hardwareConcurrency || 2, 32) }, newWorker);
  const outcomes = [];
  let next = 0;
  try {
    await Promise.all(workers.map(async (worker) => {
      while (next < protocol.cases.length) {
        const place = next;
        next += 1;
        const { outcome, message } = await worker.run(blockOfValues(valuesOf(protocol, protocol.cases[place]), chosenLaw));
        outcomes[place] = { ...named(outcome), message };
        progress.value += 1;
      }
    }));
    data.scorecard = { protocol: name, law: chosenLaw, outcomes, ...score(protocol, protocol.cases, outcomes) };
    showScorecard(protocol, longLabel(chosenLaw), (performance.now() - begin) / 1000);
  } catch (problem) {
    $("#scorecard").replaceChildren(element("p", { class: "reason bad" }, `Not evaluated: ${problem.message}.`));
  } finally {
    workers.forEach((worker) => worker.end());
    progress.hidden = true;
    buttons.forEach((button) => (button.disabled = false));
  }
}

function showScorecard(protocol, controller, seconds) {
  const { protocol: name, cost, criteria, failed, broken } = data.scorecard;
  const rows = Object.entries(protocol.criteria).map(([criterion, spec]) => {
    const [factor, unit] = SHOWN[spec.unit];
    const shown = (value) => (value === null ? "-" : `${figures(factor * value)} ${unit}`);
    return element("tr", {}, element("th", { scope: "row" }, `${criterion} ${spec.title}`), element("td", { class: "figure" }, shown(criteria[criterion])), element("td", { class: "figure" }, shown(spec.target)));
  });
  const badges = Object.entries(failed).map(([requirement, ids]) =>
    element("span", { class: `badge ${ids.length ? "not-met" : "met"}` }, ids.length ? `✗ ${requirement}: ${ids.length} cases fail, such as ${ids[0]}` : `✓ ${requirement}`));
  const [first] = broken;
  const ended = first && `${broken.length} of ${protocol.cases.length} cases ended with an error of the controller, such as ${first.id}: ${first.message || `${first.reason} at ${figures(first.time)} s`}. evaluate skips the cases that are left after a few of them, and may then give no verdict.`;
  $("#scorecard").replaceChildren(
    element("p", { id: "former", class: "reason", role: "status" }),
    element("p", { class: "hero" }, cost === null ? "-" : cost.toFixed(1)),
    element("p", {}, `V of ${controller} on ${name}: ${protocol.cases.length} cases in ${seconds.toFixed(1)} s. 100 means that every target is just met; less is better.`),
    element("p", { class: "bar" }, ...badges),
    ...(ended ? [element("p", { class: "reason bad" }, ended)] : []),
    element("div", { class: "scroll" }, element("table", {}, element("thead", {}, element("tr", {}, ...["Criterion", "value", "target"].map((words, place) => element("th", { scope: "col", class: place ? "figure" : "" }, words)))), element("tbody", {}, ...rows))));
  showFormer();
}

/** Whether two laws are the same, in whatever order their gains were set. */
const isSame = (one, other) => [one, other].map(({ values, ...more }) => JSON.stringify([more, Object.entries(values ?? {}).sort()])).every((text, _, [first]) => text === first);

/** Say so where the scorecard is that of another controller than the chosen one. */
function showFormer() {
  const former = $("#former");
  if (former) former.textContent = isSame(data.scorecard.law, state.chosen) ? "" : "The controller has been changed since: this is the scorecard of the former one.";
}

// ---- Command and link ----

/** A number without an exponent: a command line takes -1e-7 for an option. */
function plain(value) {
  const [mantissa, exponent] = String(Math.abs(value)).split("e");
  const sign = value < 0 ? "-" : "";
  if (exponent === undefined) return sign + mantissa;
  const [whole, part = ""] = mantissa.split(".");
  const place = whole.length + Number(exponent);
  const digits = whole + part;
  return sign + (place > 0 ? digits.padEnd(place, "0") : `0.${"0".repeat(-place)}${digits}`);
}

const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);

function showCommand() {
  const one = protocolCase(single, state.protocolCase);
  const { name, values, matrices } = state.chosen;
  const own = isOwn(state);
  const { plant, imperfections, force } = caseOf(state);
  const words = ["flexible-manipulator", "simulate", matrices ? fmuName(state.chosen) : `build/fmus/${name}.fmu`];
  $("#command-file").textContent = matrices ? `${fmuName(state.chosen)} is the file that the button below downloads` : "the FMUs are built by python build_fmus.py";
  if (!matrices) for (const [parameter, value] of Object.entries(values)) words.push("--set", `${parameter}=${value}`);
  if (own) {
    const arm = Object.entries(plant).filter(([parameter, value]) => value !== data.nominal[parameter] && !parameter.startsWith("q_a_start"));
    words.push("--configuration", ...degreesOf(state).map(plain), "--system", "nominal", "--test", one.test);
    if (arm.length) words.push("--plant-set", arm.map((entry) => entry.join("=")).join(","));
    if (state.seed) words.push("--seed", plain(state.seed));
    if (one.test === "disturbance") words.push("--t-3", plain(imperfections.chirp_start), "--chirp-frequencies", ...[imperfections.chirp_f_start, imperfections.chirp_f_stop].map(plain));
  } else words.push("--case", one.id);
  if (force) words.push("--force", plain(force[0]), "--phi-F", plain(force[1])); // both, or the force has other last bits
  if (state.gain) words.push("--gain", ...state.gain.map(plain));
  if (state.delay) words.push("--delay", ...state.delay.map(plain));
  const command = words.map(quoted).join(" ");
  $("#command").textContent = command;
  $("#copy-command").dataset.copy = command;
  $("#copy-command").setAttribute("aria-label", "Copy the command");
  $("#link").href = `#${encoded(state)}`;
  $("#copy-link").dataset.copy = `${location.href.split("#")[0]}#${encoded(state)}`;
  $("#copy-link").setAttribute("aria-label", "Copy the link");
}

// ---- Controls ----

/** A slider with its value in words; `set` is told the number. */
function slider(id, words, { low, high, step, value, shown = figures, unit = "" }, set) {
  const output = element("output", { for: id });
  const tell = (number) => {
    output.textContent = `${shown(number)} ${unit}`;
    input.setAttribute("aria-valuetext", output.textContent);
  };
  const input = element("input", {
    type: "range", id, min: low, max: high, step,
    oninput: () => {
      tell(Number(input.value));
      set(Number(input.value));
      update();
    },
  });
  input.value = String(value);
  tell(value);
  return element("p", { class: "slide" }, element("label", { for: id }, words), input, output);
}

const pick = (values, chosenValue) => values.map(([value, words]) => {
  const option = element("option", { value }, words);
  option.selected = value === chosenValue;
  return option;
});

function showGains() {
  const { name, values, matrices } = state.chosen;
  const known = data.controllers.find((one) => one.name === name);
  $("#matrices").hidden = !matrices;
  $("#law-problem").textContent = "";
  if (matrices) $("#law").value = JSON.stringify(matrices, null, 1).replace(/\[\s+([^[\]]*?)\s+\]/g, (_, row) => `[${row.replace(/\s+/g, " ")}]`);
  const isPid = known?.unit === "DiagonalPID_C";
  $("#gains").replaceChildren(...(isPid ? data.gains : []).flatMap(({ name: gain, values: own, most }) => [1, 2].map((axis) => {
    const parameter = `${gain}[${axis}]`;
    const value = values[parameter] ?? known.values[parameter] ?? own[axis - 1];
    const high = gain === "z_p" ? 0.995 : most * own[axis - 1];
    return slider(`gain-${gain}-${axis}`, `${gain} ${axis}`, { low: 0, high, step: high / 200, value }, (number) => {
      if (number === (known.values[parameter] ?? own[axis - 1])) delete state.chosen.values[parameter];
      else state.chosen.values[parameter] = number;
    });
  })));
  $("#kept").textContent = `Beside: ${longLabel(state.beside)}.`;
}

function showCase() {
  const one = protocolCase(single, state.protocolCase);
  const unique = (key) => [...new Set(single.cases.map((other) => other[key]))];
  const pose = data.poses.find(({ index }) => index === one.pose);
  const own = isOwn(state) ? [[OWN, "as set below"]] : [];
  $("#pose").replaceChildren(...pick([...own, ...data.poses.map(({ index, degrees }) => [String(index), `c${String(index).padStart(2, "0")}: ${degrees.join("°, ")}°`])], isOwn(state) ? OWN : String(pose.index)));
  $("#test").replaceChildren(...pick(unique("test").map((name) => [name, name]), one.test));
  $("#system").replaceChildren(...pick([...own, ...single.cases.filter(({ pose: at, test }) => at === one.pose && test === one.test).map(({ systemName }) => [systemName, systemName])], isOwn(state) ? OWN : one.systemName));
  const degrees = degreesOf(state);
  const { q_a1_deg, q_a2_deg } = data.workspace;
  $("#angles").replaceChildren(...[q_a1_deg, q_a2_deg].map(([low, high], axis) =>
    slider(`angle-${axis + 1}`, `q_a${axis + 1}`, { low, high, step: 0.1, value: degrees[axis], unit: "°" }, (number) => {
      const now = [...degreesOf(state)];
      now[axis] = number;
      setOwn({ pose: now });
    })));
  const { imperfections } = caseOf(state);
  const pushed = imperfections.force_stop > 0;
  $("#disturbance").replaceChildren(...(pushed ? [
    slider("force", "Force", { low: 0, high: MOST_FORCE, step: 10, value: state.force ?? single.force, unit: "N" }, (number) => (state.force = number)),
    slider("direction", "Its direction", { low: 0, high: 360, step: 0.1, value: turned((state.phi ?? one.phi) / RADIAN), unit: "°" }, (number) => (state.phi = number * RADIAN)),
  ] : []));
  $("#loop").replaceChildren(
    ...[1, 2].map((axis) => slider(`loop-gain-${axis}`, `Gain of axis ${axis}`, { low: 0.1, high: 5, step: 0.05, value: imperfections[`gain[${axis}]`], unit: "×" }, (number) => {
      state.gain ??= [1, 2].map((each) => imperfections[`gain[${each}]`]);
      state.gain[axis - 1] = number;
    })),
    ...[1, 2].map((axis) => slider(`delay-${axis}`, `Delay of axis ${axis}`, { low: DELAY_STEPS[0], high: DELAY_STEPS[1], step: 1, value: imperfections[`drive_delay[${axis}]`], shown: (ticks) => String((1e3 * ticks) / imperfections.rate), unit: "ms" }, (ticks) => {
      state.delay ??= [1, 2].map((each) => imperfections[`drive_delay[${each}]`] / imperfections.rate);
      state.delay[axis - 1] = ticks / imperfections.rate;
    })),
    element("p", { class: "slide" }, element("label", { for: "seed" }, "Seed of the noise"), seedInput()));
  const arm = armOf(state);
  $("#arm").replaceChildren(...data.table.flatMap(({ symbol, unit, tolerance, words }) => [1, 2].map((axis) => {
    const parameter = `${symbol}[${axis}]`;
    const nominal = data.nominal[parameter];
    const made = slider(`arm-${symbol}-${axis}`, `${symbol} ${axis}`, {
      low: -1, high: 1, step: 0.02, value: (arm[parameter] / nominal - 1) / tolerance,
      shown: (share) => `${figures(nominal * (1 + tolerance * share))}`, unit: unit === "1" ? "" : unit,
    }, (share) => setOwn({ arm: { ...armOf(state), [parameter]: nominal * (1 + tolerance * share) } }));
    made.title = `${words}; ± ${100 * tolerance} %`;
    made.querySelector("input").setAttribute("list", "nominal");
    return made;
  })), element("datalist", { id: "nominal" }, element("option", { value: "0" })));
}

/** The uncertain parameters of a state's arm. */
function armOf(given) {
  const { plant } = caseOf(given);
  return Object.fromEntries(data.table.flatMap(({ symbol }) => [1, 2].map((axis) => [`${symbol}[${axis}]`, plant[`${symbol}[${axis}]`]])));
}

/** An arm of one's own: from now on it does not follow the case. */
function setOwn(changes) {
  const begins = !isOwn(state);
  const arm = armOf(state);
  Object.assign(state, { arm, pose: degreesOf(state) }, changes);
  if (begins) for (const selector of ["#pose", "#system"]) $(selector).prepend(...pick([[OWN, "as set below"]], OWN));
}

function seedInput() {
  const input = element("input", { id: "seed", type: "number", min: 0, max: 9999, step: 1, onchange: () => {
    const seed = Math.min(9999, Math.max(0, Math.round(Number(input.value) || 0)));
    setOwn({ seed });
    input.value = String(seed); // the field stays: who types in it keeps the focus
    update();
  } });
  input.value = String(state.seed);
  return input;
}

function showAll() {
  $("#controller").replaceChildren(...pick([...data.controllers.map(({ name }) => [name, name]), ["linear", "A linear controller of my own"]], state.chosen.matrices ? "linear" : state.chosen.name));
  showGains();
  showCase();
  update();
}

/** Another case of the protocol, as it is; another test of an arm of one's own keeps this arm. */
function chooseCase() {
  const before = protocolCase(single, state.protocolCase);
  const [pose, system, test] = ["#pose", "#system", "#test"].map((selector) => $(selector).value);
  const possible = single.cases.filter((one) => (pose === OWN ? one.pose === before.pose : String(one.pose) === pose) && one.test === test);
  const one = possible.find(({ systemName }) => systemName === (system === OWN ? before.systemName : system)) ?? possible[0];
  const kept = pose === OWN && system === OWN ? { pose: state.pose, arm: state.arm, seed: state.seed } : {};
  Object.assign(state, { ...structuredClone(BEGIN), chosen: state.chosen, beside: state.beside, lesson: state.lesson, protocolCase: one.id, ...kept });
  showAll();
}

/** A law as it is at first. */
const ownLaw = (name) => (name === "linear" ? { name, matrices: data.linear } : law(name));

function startPlayground() {
  for (const selector of ["#pose", "#system", "#test"]) $(selector).addEventListener("change", chooseCase);
  const left = new Map(); // laws that others were chosen after, by name: with their gains or matrices
  $("#controller").addEventListener("change", ({ target }) => {
    left.set(state.chosen.name, state.chosen);
    state.chosen = structuredClone(left.get(target.value)) ?? ownLaw(target.value); // it may be the second one now
    showAll();
  });
  $("#reset").addEventListener("click", () => ((state.chosen = ownLaw(state.chosen.name)), showAll()));
  $("#law").addEventListener("input", ({ target }) => {
    try {
      const { A, B, C, D } = JSON.parse(target.value) ?? {};
      matrixNumbers({ A, B, C, D });
      state.chosen = { name: "linear", matrices: { A, B, C, D } };
      $("#law-problem").textContent = "";
      update();
    } catch (problem) {
      $("#law-problem").textContent = problem.message;
    }
  });
  $("#keep").addEventListener("click", () => ((state.beside = structuredClone(state.chosen)), showAll()));
  $("#swap").addEventListener("click", () => (([state.chosen, state.beside] = [state.beside, state.chosen]), showAll()));
  $("#fmu").addEventListener("click", downloadFmu);
  for (const button of document.querySelectorAll("[data-protocol]")) button.addEventListener("click", () => evaluate(button.dataset.protocol));
  $("#controls").addEventListener("submit", (event) => event.preventDefault());
  window.addEventListener("hashchange", ({ newURL }) => {
    const { hash } = new URL(newURL); // that of the location may be the former state's again
    if (document.getElementById(hash.slice(1))) {
      keepLink(); // a link to a place on the page is no state, and loses none
      return;
    }
    state = readLink(hash);
    showAll();
  });
  state = readLink(location.hash);
  showAll();
}

document.addEventListener("DOMContentLoaded", startPlayground);
