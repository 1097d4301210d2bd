// Tables whose rows are sorted by a click on a heading.

// Makes the headings of a table sort all of its bodies; `sorted` is called after that.
export function makeSortable(table, sorted = () => {}) {
  const bodies = [...table.querySelectorAll("tbody")];
  const headings = [...table.querySelectorAll("th[data-sort]")];
  const sort = (heading) => {
    const column = heading.cellIndex;
    const wasAscending = heading.getAttribute("aria-sort") === "ascending";
    const sign = wasAscending ? -1 : 1;
    for (const other of headings) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", wasAscending ? "descending" : "ascending");
    for (const body of bodies) {
      const rows = rowsOf(body).sort((a, b) => compare(a.cells[column], b.cells[column], sign));
      const mean = body.querySelector(".mean");
      for (const row of rows) body.insertBefore(row, mean);
    }
    sorted();
  };
  for (const heading of headings) {
    heading.querySelector("button").addEventListener("click", () => sort(heading));
  }
}

// The rows of a body without its title and its means.
export function rowsOf(body) {
  return [...body.rows].filter((row) => !row.matches(".mean, .title"));
}

// Cells have a number or a text to sort by. Those without one come last either way.
function compare(a, b, sign) {
  const [x, y] = [a?.dataset.value ?? "", b?.dataset.value ?? ""];
  if (x === "" || y === "") return (x === "") - (y === "");
  const [m, n] = [Number(x), Number(y)];
  return sign * (Number.isNaN(m) || Number.isNaN(n) ? x.localeCompare(y) : m - n);
}
