// Tries a report page in a headless Chromium as a reader would: opens each model, turns it, moves the slider of its levels,
// ticks every box, plays its clips, and shows its sheets. Fails if the console has an error or if something does not change
// what is seen.
//
//   npm ci && node try.mjs report.html [FOLDER]
//
// Writes screenshots to FOLDER, target/screenshots by default. CHROMIUM names the browser; /usr/bin/chromium by default.

import { mkdirSync, statSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const FLAGS = [
  "--no-sandbox",
  "--disable-gpu",
  "--disable-quic",
  "--no-first-run",
  "--disable-background-networking",
  "--disable-component-update",
  "--disable-sync",
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
];
// Time limit of each step in milliseconds: software draws the views.
const PATIENCE = 120_000;
// Time in milliseconds between two looks at the view, and the number of looks until it has followed a change.
const SETTLE = 300;
const ATTEMPTS = 40;

const [file, folder = "target/screenshots"] = process.argv.slice(2);
if (!file) {
  console.error("usage: node try.mjs report.html [FOLDER]");
  process.exit(2);
}
let problems = 0;

// Says at once what is wrong: a page of many models takes long, and may be stopped before its end.
function complain(problem) {
  problems += 1;
  console.error(`error: ${problem}`);
}

async function main() {
  mkdirSync(folder, { recursive: true });
  const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: FLAGS });
  try {
    const page = await browser.newPage({ viewport: { width: 1280, height: 900 }, reducedMotion: "reduce" });
    page.setDefaultTimeout(PATIENCE);
    page.on("console", (message) => message.type() === "error" && complain(`console: ${message.text()}`));
    page.on("pageerror", (error) => complain(`script: ${error.message}`));
    page.on("requestfailed", (request) => complain(`request: ${request.url().slice(0, 100)}`));
    await open(page);
    const models = await page.locator("details.asset").count();
    for (let number = 0; number < models; number++) await tryModel(page, number);
    await tryTable(page);
    await tryNarrow(page);
  } catch (error) {
    complain(`stopped: ${error.message}`);
  } finally {
    await browser.close();
  }
  process.exitCode = problems === 0 ? 0 : 1;
}

// Opens the page. Its first model is open and comes into view by itself.
async function open(page) {
  const start = performance.now();
  await page.goto(pathToFileURL(resolve(file)).href, { waitUntil: "load" });
  const loaded = performance.now() - start;
  if ((await page.locator("details.asset[open] .view").count()) > 0) await ready(page.locator("details.asset[open]"));
  const shown = performance.now() - start;
  const megabytes = (statSync(file).size / 1e6).toFixed(1);
  console.log(`${megabytes} MB, loaded in ${seconds(loaded)}, first model drawn after ${seconds(shown)}`);
  await page.screenshot({ path: join(folder, "page.png") });
}

async function tryModel(page, number) {
  const section = page.locator(`#asset-${number}`);
  const name = await section.locator("h3").textContent();
  const start = performance.now();
  if (!(await section.evaluate((details) => details.open))) await section.locator("> summary").click();
  if ((await section.locator(".view").count()) === 0) {
    console.log(`${name}: no 3-D view`);
    return;
  }
  await ready(section);
  console.log(`${name}: drawn after ${seconds(performance.now() - start)}`);
  const view = new View(page, section, name);
  await view.shot("rest");
  await view.drag();
  await view.levels();
  for (const box of ["lit", "wireframe", "heat", "turn"]) await view.box(box);
  await view.clips();
  await view.sheets();
}

// A click on a heading sorts the table, and a second one turns the order round.
async function tryTable(page) {
  const names = () => page.locator("#overview tbody:visible tr:not(.mean, .title) th").allTextContents();
  const heading = page.locator("#overview th[data-sort] button").first();
  const all = await names();
  if (all.length < 2) return;
  await heading.click();
  const once = await names();
  await heading.click();
  const twice = await names();
  const isTurned = String(once.toReversed()) === String(twice);
  if (!isTurned || once.length !== all.length) complain(`the table: ${once.join()} turned round is ${twice.join()}`);
}

// The page on a phone: nothing sticks out to the side.
async function tryNarrow(page) {
  await page.setViewportSize({ width: 390, height: 844 });
  await page.waitForTimeout(SETTLE);
  const overhang = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
  if (overhang > 0) complain(`on a narrow screen the page sticks out by ${overhang} pixels`);
  await page.screenshot({ path: join(folder, "narrow.png") });
}

// The 3-D view of one model and what stands around it.
class View {
  constructor(page, section, name) {
    Object.assign(this, { page, section, name });
    this.canvas = section.locator(".canvas");
  }

  input(name) {
    return this.section.locator(`.controls [name="${name}"]`);
  }

  picture() {
    return this.canvas.screenshot();
  }

  // The picture once nothing moves any more.
  async still() {
    let picture = await this.picture();
    for (let attempt = 0; attempt < ATTEMPTS; attempt++) {
      await this.page.waitForTimeout(SETTLE);
      const next = await this.picture();
      if (next.equals(picture)) return picture;
      picture = next;
    }
    complain(`${this.name}: the picture does not come to rest`);
    return picture;
  }

  async shot(what) {
    await this.page.waitForTimeout(SETTLE);
    await this.section.locator(".view").screenshot({ path: this.path(what) });
  }

  path(what) {
    return join(folder, `${this.name}-${what}.png`.replaceAll(/[^\w.-]+/g, "_"));
  }

  // The picture becomes another one, or the same one again.
  async expect(what, before, isChange) {
    for (let attempt = 0; attempt < ATTEMPTS; attempt++) {
      await this.page.waitForTimeout(SETTLE);
      if (before.equals(await this.picture()) !== isChange) return;
    }
    complain(`${this.name}, ${what}: the picture ${isChange ? "stays" : "is another one"}`);
  }

  // The mouse turns the model.
  async drag() {
    const before = await this.still();
    const box = await this.canvas.boundingBox();
    const [x, y] = [box.x + box.width / 4, box.y + box.height / 2];
    await this.page.mouse.move(x, y);
    await this.page.mouse.down();
    await this.page.mouse.move(x + 120, y - 30, { steps: 4 });
    await this.page.mouse.up();
    await this.expect("turned by the mouse", before, true);
  }

  // Every level by the slider, the largest last, with its name beside it.
  async levels() {
    const slider = this.input("level");
    const most = Number(await slider.getAttribute("max"));
    const seen = new Set();
    for (let level = 1; level <= most; level++) {
      await slider.fill(String(level));
      await this.shot(`level-${level}`);
      seen.add(await this.section.locator(".level-label").textContent());
    }
    if (seen.size !== most) complain(`${this.name}: ${most} levels, but the labels ${[...seen].join(", ")}`);
  }

  // A box changes the picture, and without its tick the picture is as before. The turntable goes on from where it is.
  async box(name) {
    const before = await this.still();
    await this.input(name).click();
    await this.expect(name, before, true);
    await this.shot(name);
    await this.input(name).click();
    if (name !== "turn") await this.expect(`${name} again`, before, false);
  }

  // Every clip moves the model, and the rest pose is as before.
  async clips() {
    const clip = this.input("clip");
    const names = (await clip.locator("option").allTextContents()).slice(1);
    if (names.length === 0) return;
    const rest = await this.still();
    for (const name of names) {
      await clip.selectOption(name);
      await this.expect(`clip ${name}`, rest, true);
      await this.expect(`clip ${name} goes on`, await this.picture(), true);
      await this.shot(`clip-${name}`);
    }
    await clip.selectOption("");
    await this.expect("rest pose", rest, false);
  }

  // One sheet is shown at a time.
  async sheets() {
    for (const button of await this.section.locator(".sheets .tabs button").all()) {
      await button.click();
      const shown = this.section.locator(".sheets figure:visible");
      const sheet = await shown.evaluateAll((all) => all.map((figure) => figure.dataset.sheet).join());
      if (sheet !== (await button.getAttribute("value"))) complain(`${this.name}: the sheets ${sheet} are shown`);
    }
    await this.section.screenshot({ path: this.path("whole") });
  }
}

// Waits until the 3-D view of a section is drawn, or has said why not.
async function ready(section) {
  const state = section.locator(".view[data-state]");
  await state.waitFor();
  if ((await state.getAttribute("data-state")) === "failed") throw new Error(await section.locator(".message").first().textContent());
}

function seconds(milliseconds) {
  return `${(milliseconds / 1000).toFixed(2)} s`;
}

await main();
