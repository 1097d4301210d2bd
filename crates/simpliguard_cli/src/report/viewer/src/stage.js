// The 3-D view of one model: source and level side by side, or what differs, seen by one camera.

import { Color, PerspectiveCamera, Vector2, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { bytesOf, levelsOf, part, split } from "./glb.js";
import { Figure } from "./figure.js";
import { HeatMap } from "./heat.js";
import { follow } from "./lights.js";

const BACKGROUND = new Color(0xd9d9d9);
// Below this width in pixels, the level stands below the source.
const NARROW = 560;
const FIELD_OF_VIEW = 35;
// A clip may move the model by this fraction of its radius before the camera tracks it.
const DEAD_ZONE = 0.25;

export class Stage {
  constructor() {
    this.renderer = null;
    this.size = new Vector2();
    this.figures = new Map();
    this.holder = null;
    this.clock = 0;
    this.last = 0;
    this.token = 0;
    this.frame = this.frame.bind(this);
  }

  // Shows the model of a holder, and forgets the one before.
  async show(holder) {
    if (this.holder === holder) return;
    this.clear();
    const token = ++this.token;
    this.holder = holder;
    try {
      this.prepare(holder);
      const file = split(bytesOf(holder.dataset.models));
      this.file = file;
      this.levels = levelsOf(file.json);
      this.makeControls();
      await this.need(0);
      await this.need(this.level);
      if (token !== this.token) return;
      this.frameModel();
      this.apply();
      holder.dataset.state = "ready";
      this.renderer.setAnimationLoop(this.frame);
    } catch (error) {
      if (token === this.token) fail(holder, error);
    }
  }

  leave(holder) {
    if (holder && this.holder === holder) this.clear();
  }

  clear() {
    this.token++;
    this.renderer?.setAnimationLoop(null);
    this.controls?.dispose();
    for (const figure of this.figures.values()) figure.dispose();
    this.figures.clear();
    if (this.holder) {
      this.holder.querySelector(".canvas").replaceChildren();
      delete this.holder.dataset.state;
    }
    this.holder = null;
  }

  prepare(holder) {
    if (!this.renderer) {
      this.renderer = new WebGLRenderer({ antialias: true });
      this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
      this.renderer.setScissorTest(true);
      this.renderer.setClearColor(BACKGROUND);
      this.heat = new HeatMap();
    }
    const place = holder.querySelector(".canvas");
    place.replaceChildren(this.renderer.domElement);
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.enableDamping = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  }

  // Loads a part of the file once: the source, which is 0, or a level.
  async need(number) {
    if (!this.figures.has(number)) {
      const token = this.token;
      const figure = await Figure.load(part(this.file, number));
      if (token !== this.token) return figure.dispose();
      this.figures.set(number, figure);
    }
  }

  makeControls() {
    const find = (name) => this.holder.querySelector(`[name="${name}"]`);
    const form = this.holder.querySelector(".controls");
    form.hidden = false;
    const slider = find("level");
    slider.min = 1;
    slider.max = Math.max(1, this.levels.length);
    slider.disabled = this.levels.length < 2;
    const clips = find("clip");
    const names = (this.file.json.animations ?? []).map((clip, i) => clip.name ?? `animation_${i}`);
    clips.replaceChildren(new Option("rest pose", ""), ...names.map((name) => new Option(name, name)));
    clips.disabled = names.length === 0;
    const turns = find("turn");
    form.oninput = () => this.change();
    form.onsubmit = (event) => event.preventDefault();
    this.inputs = { slider, clips, turns, lit: find("lit"), wireframe: find("wireframe"), heat: find("heat"), play: find("play") };
    if (!slider.dataset.isSet) {
      slider.value = slider.max;
      slider.dataset.isSet = "yes";
    }
    this.readLevel();
  }

  readLevel() {
    this.level = this.levels.length === 0 ? 0 : Number(this.inputs.slider.value);
  }

  async change() {
    this.readLevel();
    const level = this.level;
    try {
      await this.need(level);
    } catch (error) {
      if (this.holder) fail(this.holder, error);
    }
    if (this.holder && level === this.level) this.apply();
  }

  // Carries the controls over to the figures.
  apply() {
    const { clips, lit, wireframe, heat, turns, slider } = this.inputs;
    if (this.clip !== clips.value) this.clock = 0;
    this.clip = clips.value;
    for (const figure of this.shown()) {
      figure.light(lit.checked);
      figure.wireframe(wireframe.checked && !heat.checked);
      figure.play(clips.value);
      figure.at(this.clock);
      figure.scene.background = BACKGROUND;
    }
    this.controls.autoRotate = turns.checked;
    const [source, level] = this.shown();
    const count = (figure) => Math.round(figure?.triangles ?? 0).toLocaleString("en");
    this.holder.dataset.mode = heat.checked && this.level > 0 ? "heat" : this.level > 0 ? "both" : "one";
    const all = Number(this.holder.dataset.faces).toLocaleString("en");
    // The bake leaves out triangles without an area.
    const isWhole = (source?.triangles ?? 0) >= Number(this.holder.dataset.faces);
    this.holder.toggleAttribute("data-preview", !isWhole);
    this.holder.querySelector(".source-label").textContent =
      isWhole ? `Source (${all} triangles)` : `Source preview (${count(source)} of ${all} triangles)`;
    const name = this.levels[this.level - 1] ?? "";
    this.holder.querySelector(".level-label").textContent = `${name} (${count(level)} triangles)`;
    this.holder.querySelector("output").textContent = name;
    slider.setAttribute("aria-valuetext", name);
  }

  // The source, and the level that is selected.
  shown() {
    const numbers = this.level === 0 ? [0] : [0, this.level];
    return numbers.map((number) => this.figures.get(number)).filter(Boolean);
  }

  // Places the camera before the model.
  frameModel() {
    const { center, radius } = this.figures.get(0).sphere();
    const size = radius || 1;
    const distance = (1.02 * size) / Math.sin((FIELD_OF_VIEW / 2) * (Math.PI / 180));
    this.camera.near = distance / 100;
    this.camera.far = distance * 20;
    this.camera.position.copy(center).add(new Vector3(0.6, 0.35, 0.8).normalize().multiplyScalar(distance));
    this.controls.target.copy(center);
    this.home = this.figures.get(0).place();
    this.deadZone = DEAD_ZONE * size;
    this.carried = new Vector3();
    this.controls.minDistance = size * 0.1;
    this.controls.maxDistance = distance * 6;
    this.controls.update();
  }

  frame(now) {
    const passed = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    if (this.inputs.play.checked) {
      this.clock += passed;
      for (const figure of this.shown()) figure.at(this.clock);
    }
    this.track();
    this.controls.update(passed);
    this.draw();
  }

  // The camera tracks a model that a clip carries away, and comes back with it.
  track() {
    const away = this.figures.get(0).place().sub(this.home);
    const beyond = Math.max(0, away.length() - this.deadZone);
    const step = away.setLength(beyond).sub(this.carried);
    this.camera.position.add(step);
    this.controls.target.add(step);
    this.carried.add(step);
  }

  draw() {
    const place = this.holder.querySelector(".canvas");
    const [width, height] = [place.clientWidth, place.clientHeight];
    if (this.size.x !== width || this.size.y !== height) {
      // The style sheet sizes the canvas on the page.
      this.renderer.setSize(width, height, false);
      this.size.set(width, height);
    }
    const figures = this.shown();
    const isHeat = this.inputs.heat.checked && figures.length === 2;
    const isStacked = width < NARROW && !isHeat;
    this.holder.dataset.stacked = isStacked;
    const panes = isHeat ? [[0, 0, width, height]] : panesOf(figures.length, isStacked, width, height);
    const [, , paneWidth, paneHeight] = panes[0];
    this.fit(paneWidth / Math.max(1, paneHeight));
    for (const figure of figures) follow(figure.scene, this.camera, this.controls.target);
    if (isHeat) {
      const whole = { x: 0, y: 0, width, height };
      this.heat.draw(this.renderer, figures.map((figure) => figure.scene), this.camera, whole);
      return;
    }
    figures.forEach((figure, i) => {
      this.renderer.setViewport(...panes[i]);
      this.renderer.setScissor(...panes[i]);
      this.renderer.render(figure.scene, this.camera);
    });
  }

  // The model fits into the shorter side of a pane.
  fit(aspect) {
    const half = Math.tan((FIELD_OF_VIEW / 2) * (Math.PI / 180));
    const vertical = aspect < 1 ? half / aspect : half;
    this.camera.fov = (2 * Math.atan(vertical) * 180) / Math.PI;
    this.camera.aspect = aspect;
    this.camera.updateProjectionMatrix();
  }
}

// Rectangles from the bottom left: the source left of the level, or above it.
function panesOf(count, isStacked, width, height) {
  if (count < 2) return [[0, 0, width, height]];
  if (isStacked) {
    const half = Math.floor(height / 2);
    return [[0, height - half, width, half], [0, 0, width, half - 1]];
  }
  const half = Math.floor(width / 2);
  return [[0, 0, half - 1, height], [width - half, 0, half, height]];
}

function fail(holder, error) {
  holder.dataset.state = "failed";
  holder.querySelector(".message").textContent = `The 3-D view does not work here: ${error.message}`;
}
