// What differs between two drawings, as a heat map.

import { HalfFloatType, Mesh, OrthographicCamera, PlaneGeometry, Scene, ShaderMaterial, WebGLRenderTarget } from "three";

const SHADER = /* glsl */ `
  uniform sampler2D source;
  uniform sampler2D level;
  varying vec2 at;
  // The colour map magma of Matplotlib (CC0) at five even steps.
  vec3 heat(float x) {
    vec3 c0 = vec3(0.0, 0.0, 0.016), c1 = vec3(0.31, 0.071, 0.482), c2 = vec3(0.71, 0.212, 0.478);
    vec3 c3 = vec3(0.984, 0.529, 0.38), c4 = vec3(0.988, 0.992, 0.749);
    x = clamp(x, 0.0, 1.0) * 4.0;
    if (x < 1.0) return mix(c0, c1, x);
    if (x < 2.0) return mix(c1, c2, x - 1.0);
    if (x < 3.0) return mix(c2, c3, x - 2.0);
    return mix(c3, c4, x - 3.0);
  }
  // Targets hold linear light; differences count as they are seen.
  vec3 encoded(vec3 linear) { return pow(linear, vec3(1.0 / 2.2)); }
  void main() {
    vec3 d = abs(encoded(texture2D(source, at).rgb) - encoded(texture2D(level, at).rgb));
    gl_FragColor = vec4(heat(pow(dot(d, vec3(1.0 / 3.0)), 0.5)), 1.0);
  }`;

export class HeatMap {
  constructor() {
    this.targets = [0, 1].map(() => new WebGLRenderTarget(1, 1, { samples: 4, type: HalfFloatType }));
    const [source, level] = this.targets.map((target) => ({ value: target.texture }));
    const material = new ShaderMaterial({
      uniforms: { source, level },
      vertexShader: "varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }",
      fragmentShader: SHADER,
      depthTest: false,
      depthWrite: false,
    });
    this.scene = new Scene();
    this.scene.add(new Mesh(new PlaneGeometry(2, 2), material));
    this.camera = new OrthographicCamera();
  }

  // Draws two scenes aside, and what differs on the canvas.
  draw(renderer, scenes, camera, { x, y, width, height }) {
    const ratio = renderer.getPixelRatio();
    scenes.forEach((scene, i) => {
      this.targets[i].setSize(Math.max(1, width * ratio), Math.max(1, height * ratio));
      renderer.setRenderTarget(this.targets[i]);
      renderer.clear();
      renderer.render(scene, camera);
    });
    renderer.setRenderTarget(null);
    renderer.setViewport(x, y, width, height);
    renderer.setScissor(x, y, width, height);
    renderer.render(this.scene, this.camera);
  }
}
