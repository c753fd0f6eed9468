"use strict";
// What the pages of the service do beside what HTML does: uploads with progress, live parts, questions before deleting.
// Without this script, everything works but what is live.

const $ = (selector, root = document) => root.querySelector(selector);

/** Parts of the page as the server gave them: a part that somebody fills in is replaced only if the server's changes. */
const given = new Map();
const liveParts = (root) => [...root.querySelectorAll("[data-live]")];
for (const part of liveParts(document)) given.set(part.id, part.innerHTML);

/** Where this page is: a form that was refused was sent to another address, of which there is no page. */
const here = $("[data-page]")?.dataset.page ?? location.href;

async function refresh() {
  const answer = await fetch(here);
  if (!answer.ok) return location.assign("/");
  const fresh = new DOMParser().parseFromString(await answer.text(), "text/html");
  for (const part of liveParts(fresh)) {
    const old = document.getElementById(part.id);
    if (!old?.matches("[data-live]") || given.get(part.id) === part.innerHTML) continue;
    given.set(part.id, part.innerHTML);
    const ticked = [...old.querySelectorAll("input:checked")].map((box) => box.value);
    old.innerHTML = part.innerHTML;
    for (const box of old.querySelectorAll("input[type=checkbox]")) box.checked = ticked.includes(box.value);
  }
}

function follow(place) {
  const source = new EventSource(place);
  let revision = null;
  source.onmessage = ({ data }) => {
    const news = JSON.parse(data);
    if (news.final) source.close();
    // Also after the first message: something may have happened between the page and the stream.
    if (news.revision !== revision) refresh();
    revision = news.revision;
    const bar = $("#progress");
    if (!bar) return;
    if (news.total) {
      bar.max = news.total;
      bar.value = news.done;
      $("#progress-text").textContent = `${news.done} of ${news.total} cases` + (news.cost ? `, V so far ${news.cost}` : "");
    } else if (news.text) $("#progress-text").textContent = news.text;
  };
}
const followed = $("[data-events]");
if (followed) follow(followed.dataset.events);

document.addEventListener("submit", (event) => {
  const { sure } = event.target.dataset;
  if (sure && !confirm(sure)) event.preventDefault();
});

document.addEventListener("click", async ({ target }) => {
  const button = target.closest("[data-copy]");
  if (!button) return;
  await navigator.clipboard?.writeText(button.dataset.copy).then(() => (button.textContent = "copied"), () => (button.textContent = "not copied"));
  setTimeout(() => (button.textContent = "copy"), 2000);
});

document.addEventListener("input", ({ target }) => {
  if (!target.matches(".filter")) return;
  const words = target.value.toLowerCase().split(/\s+/);
  for (const row of target.closest(".card").querySelectorAll("tbody tr")) row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
});

const form = $("[data-upload]");
if (form) {
  const text = $("#upload-text");
  $("#file").multiple = true; // a form without scripts sends one
  const send = (file) => new Promise((resolve) => {
    const request = new XMLHttpRequest();
    request.open("POST", `/api/runs?name=${encodeURIComponent(file.name)}`);
    request.upload.onprogress = ({ loaded, total }) => (text.textContent = `${file.name}: ${Math.round((100 * loaded) / total)} %`);
    request.onload = () => {
      let answer = {};
      try { answer = JSON.parse(request.responseText); } catch { /* a proxy has answered */ }
      resolve(request.status === 201 ? answer : { error: answer.error || `not taken (${request.status})` });
    };
    request.onerror = () => resolve({ error: "the connection was lost" });
    request.send(file);
  });
  const upload = async (files) => {
    const problems = [];
    let last = null;
    for (const file of files) {
      const answer = file.size > Number(form.dataset.most) ? { error: "larger than what is taken" } : await send(file);
      if (answer.error) problems.push(`${file.name}: ${answer.error}`);
      else last = answer;
    }
    if (problems.length) text.textContent = problems.join("; ");
    else if (files.length === 1) return location.assign(`/runs/${last.id}`);
    else text.textContent = `${files.length} FMUs are received.`;
    form.reset();
    refresh();
  };
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    upload([...$("#file").files]);
  });
  // Anywhere on the page: a file that misses the field would else replace the page.
  addEventListener("dragover", (event) => {
    event.preventDefault();
    form.classList.add("over");
  });
  addEventListener("dragleave", () => form.classList.remove("over"));
  addEventListener("drop", (event) => {
    event.preventDefault();
    form.classList.remove("over");
    if (event.dataTransfer.files.length) upload([...event.dataTransfer.files]);
  });
}

const key = $("#key");
if (key && location.hash.length > 1) {
  key.value = location.hash.slice(1);
  history.replaceState(null, "", location.pathname); // nobody who looks over a shoulder reads it
}
