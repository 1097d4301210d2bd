// The report page: its tables, its sheets, and the 3-D view of the model that is open.

import { makeSheets } from "./sheets.js";
import { makeSortable } from "./sort.js";
import { makeOverview } from "./table.js";
import { Stage } from "./stage.js";

makeOverview(document.querySelector("#overview"));
document.querySelectorAll(".sheets").forEach(makeSheets);
document.querySelectorAll("table.sorted").forEach((table) => makeSortable(table));

// One drawing context serves all models: browsers allow few.
let stage = null;

function show(section) {
  const holder = section.querySelector(".view");
  if (!holder) return;
  stage ??= new Stage();
  stage.show(holder);
}

for (const section of document.querySelectorAll("details.asset")) {
  section.addEventListener("toggle", () => {
    if (section.open) show(section);
    else stage?.leave(section.querySelector(".view"));
  });
  if (section.open) show(section);
}

// A link of the table opens the model it leads to.
function openTarget() {
  const target = document.getElementById(location.hash.slice(1));
  if (target?.matches("details.asset")) {
    target.open = true;
    target.scrollIntoView();
  }
}
addEventListener("hashchange", openTarget);
document.addEventListener("click", (event) => {
  const link = event.target.closest('a[href^="#"]');
  if (link && link.hash === location.hash) openTarget();
});
openTarget();
