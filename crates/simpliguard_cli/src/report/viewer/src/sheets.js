// The pictures of a model: one sheet is shown at a time.

export function makeSheets(sheets) {
  const buttons = [...sheets.querySelectorAll("button")];
  const show = (name) => {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.value === name));
    for (const sheet of sheets.querySelectorAll("figure")) sheet.hidden = sheet.dataset.sheet !== name;
  };
  for (const button of buttons) button.addEventListener("click", () => show(button.value));
  sheets.querySelector(".tabs").hidden = false;
  if (buttons.length > 0) show(buttons[0].value);
}
