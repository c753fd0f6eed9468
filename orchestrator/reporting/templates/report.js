// The report: its views, and the way from a figure to the case it came from.

view("summary", drawShares);
view("workspace", drawWorkspace);
view("case", drawCase);
view("spread", drawSpread);
view("stability", drawStability);
view("motion", drawMotion);

for (const select of document.querySelectorAll(".pick")) {
  recordings.forEach((recording, index) =>
    select.append(element("option", { value: index }, `${recording.roles.map(roleText).join("; ")} (${recording.id})`)));
  select.addEventListener("change", () => {
    choose(Number(select.value));
    show(select.closest('[role="tabpanel"]').id);
  });
}
if (recordings.length) choose(current);

for (const button of document.querySelectorAll("[data-recording]")) {
  button.addEventListener("click", () => {
    choose(Number(button.dataset.recording));
    show("case");
    window.scrollTo(0, 0);
    $("#pick-case").focus();
  });
}
if ($("#path-scale")) $("#path-scale").addEventListener("change", drawCase);

startPage();
