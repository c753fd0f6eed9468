// The workspace: V_k and b_i over the configurations, and the arm in the pose of the one pointed at.

function drawWorkspace() {
  const select = $("#quantity");
  if (!select.options.length) {
    const entry = (value, text) => select.append(element("option", { value }, text));
    entry("", "V_k, the cost of a configuration");
    data.criteria.forEach((criterion, index) => entry(criterion.name, `b${index + 1}: ${criterion.title}, worst value / target`));
    select.addEventListener("change", drawWorkspace);
  }
  const name = select.value;
  const value = (configuration) => (name ? configuration.relative[name] : configuration.cost);
  const known = data.configurations.map(value).filter((entry) => entry !== null);
  const range = [Math.min(...known), Math.max(...known)];
  const { svg, world } = stage("The arm in the pose of the chosen configuration");
  for (const configuration of data.configurations) {
    const [cx, cy] = joints(configuration.q_a1, configuration.q_a2).tcp;
    const fill = value(configuration) === null ? "none" : `rgb(${blended(VIRIDIS, (value(configuration) - range[0]) / (range[1] - range[0] || 1))})`;
    world.append(drawn("circle", { cx, cy, r: 0.06, fill, stroke: colour("ink"), "stroke-width": 0.012 }));
  }
  const arm = armDrawing(colour("accent"));
  world.append(arm.group);
  $("#arm").replaceChildren(svg);
  heatMap($("#heat"), {
    configurations: data.configurations,
    value,
    range,
    colours: VIRIDIS,
    name: name ? `${name} relative to its target` : "V_k",
    ends: [figures(range[0]), `${figures(range[1])} (on target: ${name ? 1 : data.rules.cost.target})`],
    told: known.length ? "" : "no values",
    chosen: (configuration) => {
      arm.pose(configuration.q_a1, configuration.q_a2);
      const parts = data.criteria.map((criterion, index) => `b${index + 1} ${figures(configuration.relative[criterion.name])}`);
      $("#arm-text").textContent =
        `Configuration ${configuration.index}: q_a1 ${degrees(configuration.q_a1)}, q_a2 ${degrees(configuration.q_a2)}; ` +
        `V_k ${figures(configuration.cost)}; ${parts.join(", ")}. Dots: the TCP of every configuration, in the map's colours.`;
    },
  });
}
