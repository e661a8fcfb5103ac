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

  /** `moved` is told whether that is news to those who follow the camera. */
  constructor(stage: Stage, frame: HTMLElement, model: GlbModel, shown: Shown, moved: (news: boolean) => void) {
    this.stage = stage;
    this.view = new ModelView(model, shown, stage.materials);
    this.orbit = new Orbit(frame, model.up, homeDirection(model), {
      moved: (news) => {
        this.#fitted = false;
        stage.moved();
        moved(news);
      },
      held: (on) => stage.hold(on),
    });
    stage.scene.add(this.view.group);
    const points = this.view.points();
    this.orbit.setModel(points);
    this.orbit.goHome(points);
    this.#fitted = true;
    this.resized();
    // Fast first, sharp afterwards.
    stage.moved();
  }

  render(): void {
    this.view.prepare(this.orbit.forward, this.stage.cheap);
    this.stage.render(this.orbit);
  }

  /** `news`: whether to tell that the camera has moved. */
  fit(news: boolean): void {
    this.orbit.fit(this.view.points(), news);
    this.#fitted = true;
  }

  /** The stage has another size. */
  resized(): void {
    const { width, height } = this.stage.size;
    if (width === 0 || height === 0) return;
    this.orbit.setAspect(width / height);
    if (this.#fitted) this.fit(false);
  }

  dispose(): void {
    this.stage.hold(false);
    this.stage.scene.remove(this.view.group);
    this.orbit.dispose();
    this.view.dispose();
  }
}

/** From the front, a little from the patient's left and from above: so all axes can be told apart. */
function homeDirection({ up, front }: GlbModel): [number, number, number] {
  const above = new Vector3(...up);
  const before = new Vector3(...front);
  const right = new Vector3().crossVectors(above, before);
  return before.addScaledVector(right, 0.45).addScaledVector(above, 0.35).toArray();
}
