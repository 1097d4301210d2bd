// The overview: one body of the table for each level, sorted by a click on a heading, long ones cut to the first ten.

const SHOWN = 10;

export function makeOverview(overview) {
  if (!overview) return;
  const bodies = [...overview.querySelectorAll("tbody[data-level]")];
  const headings = [...overview.querySelectorAll("th[data-sort]")];
  const more = overview.querySelector(".more");
  const levels = overview.querySelector(".levels");
  let isWhole = false;

  const cut = () => {
    let longest = 0;
    for (const body of bodies) {
      const rows = [...body.rows].filter((row) => !row.matches(".mean, .title"));
      rows.forEach((row, i) => (row.hidden = !isWhole && i >= SHOWN));
      longest = Math.max(longest, rows.length);
    }
    more.hidden = longest <= SHOWN;
    more.textContent = isWhole ? `Show the first ${SHOWN}` : `Show all ${longest} models`;
  };

  const sort = (heading) => {
    const column = heading.cellIndex;
    const wasAscending = heading.getAttribute("aria-sort") === "ascending";
    const sign = wasAscending ? -1 : 1;
    for (const other of headings) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", wasAscending ? "descending" : "ascending");
    for (const body of bodies) {
      const rows = [...body.rows].filter((row) => !row.matches(".mean, .title"));
      rows.sort((a, b) => compare(a.cells[column], b.cells[column], sign));
      const mean = body.querySelector(".mean");
      for (const row of rows) body.insertBefore(row, mean);
    }
    cut();
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

  for (const heading of headings) {
    heading.querySelector("button").addEventListener("click", () => sort(heading));
  }
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

// Cells have a number or a text to sort by. Those without one come last either way.
function compare(a, b, sign) {
  const [x, y] = [a?.dataset.value ?? "", b?.dataset.value ?? ""];
  if (x === "" || y === "") return (x === "") - (y === "");
  const [m, n] = [Number(x), Number(y)];
  return sign * (Number.isNaN(m) || Number.isNaN(n) ? x.localeCompare(y) : m - n);
}
