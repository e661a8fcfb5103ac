import * as THREE from "three";
export function hello() { return new THREE.WebGLRenderer().toString(); }
