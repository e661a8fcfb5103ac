import { Vector3 } from "three";
import type { GlbModel } from "../model/glb";
import { Orbit } from "./camera";
import type { Graphics } from "./graphics";
import { ModelView } from "./model-view";
import type { Shown } from "./shown";
import { Stage } from "./stage";
import type { Theme } from "./theme";

interface Told {
  /** After each frame. */
  drawn(): void;
  /** The camera has moved; by a person, or by the program that uses the element. */
  moved(byPerson: boolean): void;
}

/** A model on the graphics card with the camera before it. */
export class Drawing {
  readonly stage: Stage;
  readonly view: ModelView;
  readonly orbit: Orbit;
  #shown: Shown;
  /** Nobody has moved the camera since everything was made to fit. */
  #fitted = true;

  constructor(graphics: Graphics, frame: HTMLElement, model: GlbModel, shown: Shown, told: Told) {
    this.#shown = shown;
    this.stage = new Stage(graphics, () => {
      this.view.prepare(this.orbit.forward);
      this.stage.render(this.orbit);
      told.drawn();
    });
    this.view = new ModelView(model);
    this.orbit = new Orbit(frame, model.up, homeDirection(model), (byPerson) => {
      this.#fitted = false;
      this.stage.moved();
      told.moved(byPerson);
    });
    frame.prepend(this.stage.canvas);
    this.stage.scene.add(this.view.group);
    this.view.show(shown);
    this.resize(frame.clientWidth, frame.clientHeight);
    this.orbit.setModel(this.#corners());
    this.orbit.goHome(this.#corners());
    this.#fitted = true;
  }

  fit(): void {
    this.orbit.fit(this.#corners());
    this.#fitted = true;
  }

  /** CSS pixels. */
  resize(width: number, height: number): void {
    if (width === 0 || height === 0) return;
    this.stage.resize(width, height);
    this.orbit.setAspect(width / height);
    if (this.#fitted) this.fit();
  }

  reshow(): void {
    this.view.show(this.#shown);
    this.stage.invalidate();
  }

  setTheme(theme: Theme): void {
    this.stage.setTheme(theme);
    this.view.setTheme(theme);
  }

  dispose(): void {
    this.orbit.dispose();
    this.view.dispose();
    this.stage.dispose();
  }

  #corners(): Vector3[] {
    return this.view.corners(this.#shown);
  }
}

/** From the front, a little from the patient's left and from above: so all axes can be told apart. */
function homeDirection({ up, front }: GlbModel): [number, number, number] {
  const above = new Vector3(...up);
  const before = new Vector3(...front);
  const right = new Vector3().crossVectors(above, before);
  return before.addScaledVector(right, 0.45).addScaledVector(above, 0.35).toArray();
}
