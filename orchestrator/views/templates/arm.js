// The arm in the x,z plane, z upwards: a drawing in metres.

/** Elbow and TCP [m] at the link angles, eq. (9). */
function joints([l_1, l_2], [q_a1, q_a2]) {
  const elbow = [l_1 * Math.sin(q_a1), l_1 * Math.cos(q_a1)];
  const q_12 = q_a1 + q_a2;
  return { elbow, tcp: [elbow[0] + l_2 * Math.cos(q_12), elbow[1] - l_2 * Math.sin(q_12)] };
}

/** An empty stage that holds an arm with these links in every pose; `label` says what it shows. */
function stage(links, label) {
  const reach = 1.08 * (links[0] + links[1]);
  const box = [-reach, -reach, 2 * reach, 2 * reach];
  const svg = drawn("svg", { viewBox: box.join(" "), role: "img", "aria-label": label });
  const flipped = drawn("g", { transform: "scale(1,-1)" });
  const line = colour("line");
  for (let metre = -Math.floor(reach); metre <= reach; metre += 1) {
    flipped.append(
      drawn("path", { d: `M${-reach},${metre}H${reach}M${metre},${-reach}V${reach}`, stroke: line, "stroke-width": 0.008, fill: "none" })
    );
  }
  svg.append(flipped);
  svg.append(
    ...[["x [m]", reach - 0.42, reach - 0.06], ["z [m]", -reach + 0.04, -reach + 0.14]].map(([text, x, y]) =>
      drawn("text", { x, y, "font-size": 0.14, fill: colour("soft") }, text)),
    // At the edges, where no pose reaches.
    ...[-2, -1, 0, 1, 2].flatMap((metre) => [
      drawn("text", { x: metre + 0.03, y: reach - 0.06, "font-size": 0.12, fill: colour("soft") }, String(metre)),
      drawn("text", { x: -reach + 0.04, y: -metre - 0.03, "font-size": 0.12, fill: colour("soft") }, String(metre)),
    ])
  );
  // What would reach beyond the frame: the playground shows what is drawn there, for the end of a pull.
  const framed = drawn("svg", { x: box[0], y: box[1], width: box[2], height: box[3], viewBox: box.join(" ") });
  flipped.append(framed);
  return { svg, world: flipped, framed };
}

/** A drawing of the arm; `pose` moves it. */
function armDrawing(lengths, stroke, width = 0.07, opacity = 1) {
  const links = drawn("path", { fill: "none", stroke, "stroke-width": width, "stroke-linecap": "round", "stroke-linejoin": "round" });
  const points = [1, 1, 0.8].map((size) => drawn("circle", { r: size * width, fill: colour("card"), stroke, "stroke-width": 0.4 * width }));
  const group = drawn("g", { opacity }, links, ...points);
  const pose = (angles) => {
    const { elbow, tcp } = joints(lengths, angles);
    links.setAttribute("d", `M0,0L${elbow}L${tcp}`);
    [[0, 0], elbow, tcp].forEach(([x, y], index) => {
      points[index].setAttribute("cx", x);
      points[index].setAttribute("cy", y);
    });
    return tcp;
  };
  return { group, pose };
}

const standing = new Map();

/** The arm beside a map, in the pose of the cell that is pointed at; dots are the TCP of all, in the map's colours. */
function drawArm(place) {
  const { links, heat, poses } = data.arms[place.id];
  const { svg, world } = stage(links, "The arm in the pose of the chosen cell; dots: the TCP in the poses of all");
  const arm = armDrawing(links, colour("accent"));
  const group = drawn("g");
  world.append(group, arm.group);
  place.replaceChildren(svg);
  const map = $(`#${heat}`);
  if (standing.has(place)) map.removeEventListener("pointed", standing.get(place));
  standing.set(place, ({ detail: { cell, hues } }) => {
    group.replaceChildren(...poses.flatMap((angles, index) => {
      if (!angles) return [];
      const [cx, cy] = joints(links, angles).tcp;
      const fill = hues[index] ? `rgb(${hues[index]})` : "none";
      return [drawn("circle", { cx, cy, r: 0.06, fill, stroke: colour("ink"), "stroke-width": 0.012 })];
    }));
    arm.pose(poses[cell]);
  });
  map.addEventListener("pointed", standing.get(place));
  drawHeat(map);
}

painters.set(".arm:not(#stage)", drawArm);
