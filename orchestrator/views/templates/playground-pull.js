// The force at the tool, pulled in the drawing of the arm with a mouse, a finger or the arrow keys.

const PER_METRE = 2000; // [N] so that the ring stays in sight in nearly every pose
const KEYS = { ArrowUp: [20, 0], ArrowDown: [-20, 0], ArrowLeft: [0, 5], ArrowRight: [0, -5], PageUp: [100, 0], PageDown: [-100, 0] }; // [N], [degrees]

/** An angle [degrees] from 0 on, below 360. */
const turned = (degrees) => ((degrees % 360) + 360) % 360;

/** Size [N] and direction [degrees] of the state's force, or null in a test that has none. */
function pulled() {
  const one = protocolCase(single, state.protocolCase);
  return caseOf(state).imperfections.force_stop > 0 ? [state.force ?? single.force, turned((state.phi ?? one.phi) / RADIAN)] : null;
}

/** Draw the force as a line from the tool, whose end can be moved; the case is repeated when it is let go. */
function drawPull(place) {
  const had = document.activeElement?.id === "pull";
  drawMotion(place);
  let now = pulled();
  $("#pull-text").textContent = now ? "Pull the tool: drag the ring at the end of the dashed line, or give it the focus and press the arrow keys." : "In this test no force acts.";
  if (!now) return;
  const svg = $("svg", place);
  const world = $("g", svg);
  svg.setAttribute("role", "group"); // with something in it that can be moved
  const home = joints(data.links, degreesOf(state).map((angle) => angle * RADIAN)).tcp;
  const line = drawn("path", { stroke: colour("limit"), "stroke-width": 0.025, "stroke-dasharray": "0.06 0.04" });
  const grip = drawn("circle", { class: "grip", r: 0.08, fill: colour("card"), stroke: colour("limit"), "stroke-width": 0.025 });
  const around = drawn("circle", { r: 0.22, fill: "transparent" }); // so much a finger hits
  const handle = drawn("g", { id: "pull", tabindex: 0, role: "slider", "aria-label": "Force at the tool", "aria-valuemin": 0, "aria-valuemax": MOST_FORCE }, around, grip);
  world.append(line, handle);

  const show = ([size, direction]) => {
    now = [size, direction];
    const [cx, cy] = [home[0] + (size / PER_METRE) * Math.cos(direction * RADIAN), home[1] + (size / PER_METRE) * Math.sin(direction * RADIAN)];
    line.setAttribute("d", `M${home}L${[cx, cy]}`);
    for (const circle of [grip, around]) for (const [name, value] of [["cx", cx], ["cy", cy]]) circle.setAttribute(name, value);
    handle.setAttribute("aria-valuenow", size);
    handle.setAttribute("aria-valuetext", `${figures(size)} newtons at ${figures(direction)} degrees`);
  };
  const put = () => {
    [state.force, state.phi] = [now[0], now[1] * RADIAN];
    showAll();
  };
  const follow = ({ clientX, clientY }) => {
    const { x, y } = new DOMPoint(clientX, clientY).matrixTransform(world.getScreenCTM().inverse());
    const size = Math.min(MOST_FORCE, 10 * Math.round((PER_METRE * Math.hypot(x - home[0], y - home[1])) / 10));
    show([size, size ? turned(Math.round(Math.atan2(y - home[1], x - home[0]) / RADIAN)) : now[1]]);
  };
  // A finger on the ring does not scroll the page; the style touch-action has no effect inside a drawing.
  handle.addEventListener("touchstart", (event) => event.preventDefault(), { passive: false });
  // The state may be another since this was drawn: a slider or a list has changed it, and the case is still simulated.
  const begins = () => (now = pulled()) !== null;
  handle.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    if (!begins()) return;
    handle.focus();
    handle.setPointerCapture(event.pointerId);
    handle.addEventListener("pointermove", follow);
    handle.addEventListener("pointerup", put);
  });
  handle.addEventListener("pointercancel", () => drawPull(place));
  handle.addEventListener("keydown", (event) => {
    if (!(event.key in KEYS)) return;
    event.preventDefault();
    if (!begins()) return;
    const [more, further] = KEYS[event.key];
    show([Math.min(MOST_FORCE, Math.max(0, now[0] + more)), turned(now[1] + further)]);
    put();
  });
  show(now);
  if (had) handle.focus({ preventScroll: true });
}

painters.set("#stage", drawPull);
