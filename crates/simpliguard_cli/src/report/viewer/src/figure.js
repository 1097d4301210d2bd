// A model in the view: loaded from a part of its file, drawn lit or unlit, with or without its edges, in a clip or at rest.

import {
  AnimationMixer,
  Box3,
  Color,
  MeshBasicMaterial,
  Scene,
  Sphere,
  Vector3,
} from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { addLights } from "./lights.js";

const EDGES = new Color(0x1c7ed6);

export class Figure {
  static async load(buffer) {
    const gltf = await new GLTFLoader().parseAsync(buffer, "");
    return new Figure(gltf);
  }

  constructor(gltf) {
    this.scene = new Scene();
    this.scene.add(gltf.scene);
    addLights(this.scene);
    this.clips = gltf.animations;
    this.mixer = new AnimationMixer(gltf.scene);
    this.root = gltf.scene;
    this.meshes = [];
    gltf.scene.traverse((object) => {
      if (object.isMesh) this.meshes.push(object);
      if (object.isLight) object.visible = false;
    });
    this.triangles = 0;
    for (const mesh of this.meshes) {
      // Skinned bounds are those of the rest pose.
      mesh.frustumCulled = false;
      const { index, attributes } = mesh.geometry;
      this.triangles += ((index ?? attributes.position).count / 3) * (mesh.count ?? 1);
      mesh.userData.lit = mesh.material;
      mesh.userData.unlit = unlit(mesh.material);
    }
    this.edges = [];
  }

  // A sphere around the model at rest: the centre of its bounding box, and the distance of the farthest vertex.
  sphere() {
    this.root.updateMatrixWorld(true);
    const box = new Box3();
    this.eachVertex((vertex) => box.expandByPoint(vertex));
    if (box.isEmpty()) return new Sphere(undefined, 1);
    const center = box.getCenter(new Vector3());
    let farthest = 0;
    this.eachVertex((vertex) => (farthest = Math.max(farthest, vertex.distanceToSquared(center))));
    return new Sphere(center, Math.sqrt(farthest));
  }

  eachVertex(visit) {
    const vertex = new Vector3();
    for (const mesh of this.meshes) {
      const count = mesh.geometry.attributes.position.count;
      for (let i = 0; i < count; i++) visit(mesh.getVertexPosition(i, vertex).applyMatrix4(mesh.matrixWorld));
    }
  }

  // Where the model is: the mean place of its bones, or else of its meshes.
  place() {
    this.root.updateMatrixWorld(true);
    const bones = this.meshes.flatMap((mesh) => mesh.skeleton?.bones ?? []);
    const parts = bones.length > 0 ? bones : this.meshes;
    const sum = new Vector3();
    for (const { matrixWorld } of parts) sum.add(new Vector3().setFromMatrixPosition(matrixWorld));
    return sum.divideScalar(Math.max(1, parts.length));
  }

  light(isLit) {
    for (const mesh of this.meshes) mesh.material = isLit ? mesh.userData.lit : mesh.userData.unlit;
  }

  wireframe(isOn) {
    if (isOn && this.edges.length === 0) this.edges = this.meshes.map(edgesOf);
    for (const edges of this.edges) edges.visible = isOn;
  }

  // Plays the clip of a name; none for the rest pose.
  play(name) {
    this.mixer.stopAllAction();
    const clip = this.clips.find((clip) => clip.name === name);
    if (clip) this.mixer.clipAction(clip).play();
  }

  at(seconds) {
    this.mixer.setTime(seconds);
  }

  dispose() {
    this.mixer.stopAllAction();
    for (const mesh of this.meshes) {
      mesh.geometry.dispose();
      for (const material of [mesh.userData.lit, mesh.userData.unlit].flat()) {
        for (const value of Object.values(material)) {
          if (value?.isTexture) value.dispose();
        }
        material.dispose();
      }
    }
    for (const edges of this.edges) edges.material.dispose();
  }
}

// Base colour alone, as without any light.
function unlit(material) {
  if (Array.isArray(material)) return material.map(unlit);
  return new MeshBasicMaterial({
    name: material.name,
    color: material.color ?? new Color(1, 1, 1),
    map: material.map ?? null,
    alphaTest: material.alphaTest,
    opacity: material.opacity,
    transparent: material.transparent,
    depthWrite: material.depthWrite,
    side: material.side,
    vertexColors: material.vertexColors,
  });
}

// The triangles of a mesh as lines over it, moved by the same skeleton.
function edgesOf(mesh) {
  const edges = mesh.clone(false);
  edges.material = new MeshBasicMaterial({
    color: EDGES,
    wireframe: true,
    transparent: true,
    opacity: 0.55,
    depthWrite: false,
    polygonOffset: true,
    polygonOffsetFactor: -1,
    polygonOffsetUnits: -1,
  });
  edges.frustumCulled = false;
  edges.renderOrder = 1;
  edges.userData = {};
  if (mesh.morphTargetInfluences) edges.morphTargetInfluences = mesh.morphTargetInfluences;
  mesh.parent.add(edges);
  return edges;
}
