// The light of the view: sky and ground, and a lamp that stays at the camera.

import { AmbientLight, DirectionalLight, HemisphereLight } from "three";

export function addLights(scene) {
  scene.add(new HemisphereLight(0xffffff, 0x8a8578, 1.4));
  scene.add(new AmbientLight(0xffffff, 0.35));
  const lamp = new DirectionalLight(0xffffff, 2.2);
  lamp.name = "lamp";
  scene.add(lamp, lamp.target);
}

// Moves the lamp to the camera, a little above it and to its left.
export function follow(scene, camera, target) {
  const lamp = scene.getObjectByName("lamp");
  lamp.position.set(-0.4, 0.5, 0).applyQuaternion(camera.quaternion);
  lamp.position.multiplyScalar(camera.position.distanceTo(target)).add(camera.position);
  lamp.target.position.copy(target);
}
