// The workspace: V_k and b_i over the configurations, and the arm in the pose of the one pointed at.

function drawWorkspace() {
  const quantities = data.criteria.map((criterion, index) => [criterion.name, `b${index + 1}: ${criterion.title}, worst value / target`]);
  const name = options("quantity", [["", "V_k, the cost of a configuration"], ...quantities], drawWorkspace).value;
  const value = (configuration) => (name ? configuration.relative[name] : configuration.cost);
  const known = data.configurations.map(value).filter((entry) => entry !== null);
  const range = [Math.min(...known), Math.max(...known)];
  const dots = data.configurations.map((configuration) => {
    const [cx, cy] = joints(configuration.q_a1, configuration.q_a2).tcp;
    const fill = value(configuration) === null ? "none" : `rgb(${blended(VIRIDIS, (value(configuration) - range[0]) / (range[1] - range[0] || 1))})`;
    return drawn("circle", { cx, cy, r: 0.06, fill, stroke: colour("ink"), "stroke-width": 0.012 });
  });
  workspaceMap({
    value,
    range,
    dots,
    colours: VIRIDIS,
    name: name ? `${name} relative to its target` : "V_k",
    ends: [figures(range[0]), `${figures(range[1])} (on target: ${name ? 1 : data.rules.cost.target})`],
    told: known.length ? "" : "no values",
    about: (configuration) => {
      const parts = data.criteria.map((criterion, index) => `b${index + 1} ${figures(configuration.relative[criterion.name])}`);
      return `V_k ${figures(configuration.cost)}; ${parts.join(", ")}. Dots: the TCP of every configuration, in the map's colours.`;
    },
  });
}
