// The lesson of the playground: five steps, each with views that set the page, and a question that they answer.

const HIGH_GAIN = law("DiagonalPID_C", { "K_p[1]": 180, "K_p[2]": 60, "K_d[1]": 6, "K_d[2]": 2 });
const FRICTION = { protocolCase: "c08.compliant.disturbance", pose: [54, 80] };
const FOUND_ARM = {
  "m[1]": 55.00000000000001, "m[2]": 160.455, "k_low[1]": 600000, "k_low[2]": 207560, "k_high[1]": 1357800, "k_high[2]": 240000,
  "psi[1]": 0.0006980153455142655, "psi[2]": 0.0010471975511965976, "d[1]": 480, "d[2]": 160, "f_d[1]": 0.0011999999999999997,
  "f_d[2]": 0.0011063999999999998, "f_c[1]": 0.5819999999999999, "f_c[2]": 0.24639999999999995, "mu_k[1]": 0.3385, "mu_k[2]": 0.75,
  "beta[1]": 0.6000000000000001, "beta[2]": 0.5624000000000001, "alpha[1]": 2.71, "alpha[2]": 6.477500000000001, "gamma[1]": 1.0676,
  "gamma[2]": 0.9509,
};
const ROBUST = { chosen: law("RobustLQG"), beside: law("DiagonalPID_C") };

/** `look` has the beginnings of the rows of figures that answer; `right` is the number of the true answer. */
const LESSON = [
  {
    title: "What friction does",
    text: "Both views are the same arm with the paper's PID, but for the Coulomb friction f_c of the motors: at the lower end of its tolerance, and at the upper end. B6 is the time that the tool takes after the force, B7 its error while the motor torques ripple.",
    views: [["The least friction", { ...FRICTION, arm: { "f_c[1]": 0.3, "f_c[2]": 0.2 } }], ["The most friction", { ...FRICTION, arm: { "f_c[1]": 2.7, "f_c[2]": 1.8 } }]],
    look: ["B6", "B7"],
    question: "Is more friction good or bad for the tool?",
    answers: ["Good: both criteria become better.", "Bad: both criteria become worse.", "Good against the torque ripple, bad for the settling time."],
    right: 2,
    because: "Friction holds the motors against the torque ripple, so that B7 falls from 1.26 to 0.355 mm. After the force it holds them as well, off their place, until the integral part has pulled them back: B6 rises from 2.64 to 3.31 s.",
  },
  {
    title: "What the motor angles do not show",
    text: "The controller sees the motor angles alone. The first view has the paper's PID. The second has four times its gains K_p and K_d, so that the motors move less.",
    views: [["The paper's gains", { protocolCase: "c08.compliant.disturbance" }], ["Four times the gains", { protocolCase: "c08.compliant.disturbance", chosen: HIGH_GAIN }]],
    look: ["B5"],
    question: "The motors hardly move any more. Why is most of the TCP error still there?",
    answers: ["The gears bend between motor and link, where nothing is measured.", "The measurement noise hides the motion.", "The torque is at its limit."],
    right: 0,
    because: "The gears bend. With the paper's gains the motor angles show 0.522 of 2.02 mm, with the high gains 0.140 of 1.66 mm: the motors have become stiff, the gears have not.",
  },
  {
    title: "What A2 asks for",
    text: "The high gains again. The second view is a case of A2: the torque of axis 2 comes 1.5 ms later.",
    views: [["The loop's own delay", { protocolCase: "c08.compliant.delay_2", chosen: HIGH_GAIN, delay: [0.00025, 0.00025] }], ["1.5 ms more", { protocolCase: "c08.compliant.delay_2", chosen: HIGH_GAIN }]],
    look: ["A2", "Amplitude"],
    question: "What do 1.5 ms do, where the force lasts 500 ms?",
    answers: ["Nothing: they are too short.", "The loop oscillates and does not come to rest.", "The tool leaves the workspace."],
    right: 1,
    because: "The torque comes too late for the fast motion that high gains make, and feeds it: at the end of the case the tool still oscillates by 91 µm, at 43 Hz. With the paper's gains the same case stands still.",
  },
  {
    title: "Why gain helps B5 and breaks A1",
    text: "The first two views compare the paper's gains with four times K_p and K_d under the force. The third is a case of A1 with the high gains: the loop gain of axis 2 is 2.5 times as large.",
    views: [["The paper's gains", { protocolCase: "c08.compliant.disturbance" }], ["Four times", { protocolCase: "c08.compliant.disturbance", chosen: HIGH_GAIN }], ["Four times, tested by A1", { protocolCase: "c08.slippery.gain_2", chosen: HIGH_GAIN }]],
    look: ["B5", "B7", "A1", "Amplitude"],
    question: "What do the higher gains cost?",
    answers: ["Nothing: B5, B7 and A1 become better.", "They make B5 worse.", "They use up the margin: a larger loop gain ends in a limit cycle."],
    right: 2,
    because: "B5 falls from 2.02 to 1.66 mm and B7 from 0.746 to 0.332 mm. But with 2.5 times the loop gain a limit cycle of 14.8 µm remains, and A3 allows less than 10 µm. With the paper's gains the tool stands still in this case.",
  },
  {
    title: "What a worst arm looks like",
    text: "RobustLQG meets A2 on the first arm, which the protocol names. A search found the second arm. Open the arm's parameters below, and look where the sliders stand.",
    views: [["An arm of the protocol", { ...ROBUST, protocolCase: "c07.compliant.delay_1" }], ["The arm that was found", { ...ROBUST, protocolCase: "c07.compliant.delay_1", pose: [-28.9, 13.1], phi: 1.9242670095264438, arm: FOUND_ARM }]],
    look: ["A2", "Amplitude", "Error"],
    question: "How many parameters of the found arm lie outside their tolerances?",
    answers: ["None.", "One.", "Nearly all of them."],
    right: 0,
    because: "None: all sliders are within their ends, many at an end. It is their combination, in a pose that the protocol does not have. The tool stays 227 mm away and oscillates by 32.6 mm, while the paper's PID stands still on this arm.",
  },
];

const lessonState = (step, view) => ({ ...structuredClone(BEGIN), ...structuredClone(LESSON[step].views[view][1]), lesson: [step, view] });

/** Go to a view of a step, or end the lesson with null. */
function goToLesson(step, view = 0) {
  if (step === null) state.lesson = null;
  else state = lessonState(step, view);
  showAll();
}

/** The lesson as the state has it; a new step has the focus on its title, from where it is read on. */
function showLesson() {
  const place = $("#lesson");
  const [step, view] = state.lesson ?? [null, null];
  $(".play").classList.toggle("taught", step !== null);
  const turn = (words, to) => element("button", { type: "button", onclick: () => { goToLesson(to); $("#lesson h2").focus(); } }, words);
  if (step === null) {
    place.dataset.step = "";
    place.replaceChildren(element("h2", { tabindex: -1 }, "A lesson in five steps"), element("p", { class: "bar" }, turn("Begin the lesson", 0), " Each step sets the page and asks one question. What is seen answers it."));
    return;
  }
  const { title, text, views, question, answers, right, because } = LESSON[step];
  if (place.dataset.step !== String(step)) {
    const verdict = element("p", { role: "status", id: "lesson-verdict" });
    const answer = (number) => (verdict.replaceChildren(element("b", { class: number === right ? "good" : "bad" }, number === right ? "✓ Yes." : "✗ No."), ` ${number === right ? because : "Look at the figures of all views again."}`));
    place.dataset.step = String(step);
    place.replaceChildren(
      element("h2", { tabindex: -1 }, `${step + 1} of ${LESSON.length}: ${title}`),
      element("p", {}, text),
      element("p", { class: "bar", role: "group", "aria-label": "Set the page" }, ...views.map(([words], number) => element("button", { type: "button", onclick: () => goToLesson(step, number) }, words))),
      element("p", { id: "lesson-seen", "aria-live": "polite" }),
      element("fieldset", {}, element("legend", {}, question), ...answers.map((words, number) => element("label", {}, element("input", { type: "radio", name: "lesson-answer", onchange: () => answer(number) }), ` ${words}`))),
      verdict,
      element("p", { class: "bar" }, ...(step > 0 ? [turn("Back", step - 1)] : []), step + 1 < LESSON.length ? turn("Next step", step + 1) : "", turn("End the lesson", null)));
  }
  // What somebody has changed since is no view any more.
  const isView = JSON.stringify(state) === JSON.stringify(lessonState(step, view));
  place.querySelectorAll('[role="group"] button').forEach((button, number) => button.setAttribute("aria-pressed", String(isView && number === view)));
}

/** The figures that the question is about, once they are simulated. */
function showSeen() {
  if (!state.lesson) return;
  const { look } = LESSON[state.lesson[0]];
  const rows = [...document.querySelectorAll("#figures tbody tr")].map((row) => [...row.children].map((cell) => cell.textContent));
  const seen = rows.filter(([name]) => look.some((begin) => name.startsWith(begin)));
  $("#lesson-seen").replaceChildren(...seen.map(([name, one, two]) => element("span", {}, `${name}: `, element("b", {}, one), ` with ${label(state.chosen)}, ${two} with ${label(state.beside)}`)));
}
