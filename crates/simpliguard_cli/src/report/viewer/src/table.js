// The overview: one body of the table for each level, sorted by a click on a heading, long ones cut to the first ten.

import { makeSortable, rowsOf } from "./sort.js";

const SHOWN = 10;

export function makeOverview(overview) {
  if (!overview) return;
  const bodies = [...overview.querySelectorAll("tbody[data-level]")];
  const more = overview.querySelector(".more");
  const levels = overview.querySelector(".levels");
  let isWhole = false;

  const cut = () => {
    let longest = 0;
    for (const body of bodies) {
      const rows = rowsOf(body);
      rows.forEach((row, i) => (row.hidden = !isWhole && i >= SHOWN));
      longest = Math.max(longest, rows.length);
    }
    more.hidden = longest <= SHOWN;
    more.textContent = isWhole ? `Show the first ${SHOWN}` : `Show all ${longest} models`;
  };

  const select = (level) => {
    for (const body of bodies) {
      body.hidden = body.dataset.level !== level;
      for (const title of body.querySelectorAll(".title")) title.hidden = true;
    }
    for (const button of levels.querySelectorAll("button")) {
      button.setAttribute("aria-pressed", String(button.value === level));
    }
  };

  makeSortable(overview, cut);
  for (const button of levels.querySelectorAll("button")) {
    button.addEventListener("click", () => select(button.value));
  }
  more.addEventListener("click", () => {
    isWhole = !isWhole;
    cut();
  });
  levels.hidden = bodies.length < 2;
  if (bodies.length > 0) select(bodies[0].dataset.level);
  cut();
}
