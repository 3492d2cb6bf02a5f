"use strict";
// Sorting, filtering, and the ribbon of a film; without this script the page shows everything.

function sortBy(table, index, ascending) {
  const rows = [...table.tBodies[0].rows];
  const key = (row) => row.cells[index].dataset.order;
  const sign = ascending ? 1 : -1;
  rows.sort((one, other) => {
    const [a, b] = [key(one), key(other)];
    if (a === undefined || b === undefined) return (a === undefined) - (b === undefined); // missing ones stay last
    const [x, y] = [orderOf(a), orderOf(b)];
    const bothNumbers = typeof x === "number" && typeof y === "number";
    return sign * (bothNumbers ? (x > y) - (x < y) : String(a).localeCompare(String(b)));
  });
  table.tBodies[0].append(...rows);
  for (const head of table.tHead.rows[0].cells) head.removeAttribute("aria-sort");
  table.tHead.rows[0].cells[index].setAttribute("aria-sort", ascending ? "ascending" : "descending");
}

function orderOf(text) {
  if (text === "inf") return Infinity;
  const number = Number(text);
  return text !== "" && !Number.isNaN(number) ? number : text;
}

function makeSortable(table) {
  [...table.tHead.rows[0].cells].forEach((head, index) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => sortBy(table, index, head.getAttribute("aria-sort") !== "ascending"));
  });
}

function filter(form) {
  const hidden = { backend: new Set(), method: new Set() };
  for (const box of form.elements) if (box.type === "checkbox" && !box.checked) hidden[box.name].add(box.value);
  for (const part of document.querySelectorAll("[data-backend], [data-method]")) {
    const { backend, method } = part.dataset;
    part.toggleAttribute("data-hidden", hidden.backend.has(backend) || hidden.method.has(method));
  }
}

function follow(film) {
  const [video, ribbon, said] = ["video", ".ribbon", "output"].map((name) => film.querySelector(name));
  const stretches = [...ribbon.querySelectorAll("i")];
  const show = () => {
    if (video.duration) ribbon.querySelector("b").style.left = `${(100 * video.currentTime) / video.duration}%`;
    const now = stretches.filter((stretch) => Number(stretch.dataset.start) <= video.currentTime + 1e-6).pop();
    said.textContent = now.title;
    if (!video.paused) requestAnimationFrame(show);
  };
  for (const event of ["play", "seeked", "timeupdate", "loadedmetadata"]) video.addEventListener(event, show);
  ribbon.addEventListener("click", (event) => {
    const { left, width } = ribbon.getBoundingClientRect();
    if (video.duration) video.currentTime = (video.duration * (event.clientX - left)) / width;
  });
}

document.querySelectorAll(".film").forEach(follow);
document.querySelectorAll("table.sortable").forEach(makeSortable);
const form = document.getElementById("filters");
form.hidden = !form.querySelector("input");
form.addEventListener("change", () => filter(form));
filter(form); // a browser may remember what was ticked
