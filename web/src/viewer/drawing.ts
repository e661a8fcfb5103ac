import { Vector3 } from "three";
import type { GlbModel } from "../model/glb";
import { Orbit } from "./camera";
import { ModelView } from "./model-view";
import type { Shown } from "./shown";
import type { Stage } from "./stage";

/** A model on a stage with the camera before it. */
export class Drawing {
  readonly stage: Stage;
  readonly view: ModelView;
  readonly orbit: Orbit;
  /** Nobody has moved the camera since everything was made to fit. */
  #fitted = true;

  /** `moved` is told whether a person moved the camera or else the program that uses the element. */
  constructor(stage: Stage, frame: HTMLElement, model: GlbModel, shown: Shown, moved: (byPerson: boolean) => void) {
    this.stage = stage;
    this.view = new ModelView(model, shown, stage.materials);
    this.orbit = new Orbit(frame, model.up, homeDirection(model), (byPerson) => {
      this.#fitted = false;
      stage.moved();
      moved(byPerson);
    });
    stage.scene.add(this.view.group);
    this.orbit.setModel(this.#corners());
    this.orbit.goHome(this.#corners());
    this.#fitted = true;
    this.resized();
    // Fast first, sharp afterwards.
    stage.moved();
  }

  render(): void {
    this.view.prepare(this.orbit.forward, this.stage.cheap);
    this.stage.render(this.orbit);
  }

  fit(): void {
    this.orbit.fit(this.#corners());
    this.#fitted = true;
  }

  /** The stage has another size. */
  resized(): void {
    const { width, height } = this.stage.size;
    if (width === 0 || height === 0) return;
    this.orbit.setAspect(width / height);
    if (this.#fitted) this.fit();
  }

  reshow(): void {
    this.view.reshow();
    this.stage.invalidate();
  }

  dispose(): void {
    this.stage.scene.remove(this.view.group);
    this.orbit.dispose();
    this.view.dispose();
  }

  #corners(): Vector3[] {
    return this.view.corners();
  }
}

/** From the front, a little from the patient's left and from above: so all axes can be told apart. */
function homeDirection({ up, front }: GlbModel): [number, number, number] {
  const above = new Vector3(...up);
  const before = new Vector3(...front);
  const right = new Vector3().crossVectors(above, before);
  return before.addScaledVector(right, 0.45).addScaledVector(above, 0.35).toArray();
}
