import { DEFAULT_LAYERS, LAYERS, type Layer } from "../model/glb";

export function isLayer(name: string): name is Layer {
  return (LAYERS as readonly string[]).includes(name);
}

/** Which layers, structures and figures are to be seen. */
export class Shown {
  layers = new Set<Layer>(DEFAULT_LAYERS);
  #hiddenStructures = new Set<number>();
  #hiddenFigures = new Set<string>();
  #only: number | null = null;

  setStructure(structure: number, shown: boolean): void {
    if (shown) this.#hiddenStructures.delete(structure);
    else this.#hiddenStructures.add(structure);
  }

  setFigure(structure: number, figure: number, shown: boolean): void {
    const key = `${structure} ${figure}`;
    if (shown) this.#hiddenFigures.delete(key);
    else this.#hiddenFigures.add(key);
  }

  /** Null: all that are not hidden. */
  showOnly(structure: number | null): void {
    this.#only = structure;
  }

  structure(structure: number): boolean {
    return (this.#only === null || this.#only === structure) && !this.#hiddenStructures.has(structure);
  }

  /** The object, which is of no figure, is seen with its structure. */
  figure(structure: number, figure: number | null): boolean {
    return this.structure(structure) && !this.#hiddenFigures.has(`${structure} ${figure}`);
  }

  mesh(mesh: { layer: Layer; structure: number; figure: number | null }): boolean {
    return this.layers.has(mesh.layer) && this.figure(mesh.structure, mesh.figure);
  }

  /** All structures and figures again, as before a model was loaded. */
  reset(): void {
    this.#hiddenStructures.clear();
    this.#hiddenFigures.clear();
    this.#only = null;
  }
}
