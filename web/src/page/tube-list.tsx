import type { Figure, Structure, Tube } from "../model/thickness";
import { figureName, number, structureName } from "./words";

export function isTube(figure: Figure): figure is Tube {
  return figure.kind === "tube";
}

/** What the tubes of the structures measure, in words. */
export function TubeList({ structures }: { structures: Structure[] }) {
  const withTubes = structures.filter(({ figures }) => figures.some(isTube));
  if (withTubes.length === 0) return null;
  return (
    <section aria-label="Summary of tubes">
      <h4>Tubes</h4>
      <ul class="tubes">
        {withTubes.flatMap((structure) =>
          structure.figures.filter(isTube).map((tube) => (
            <li key={`${structure.index}/${tube.index}`}>
              {structureName(structure)}, {figureName({ index: tube.index })}: {tubeText(tube)}
            </li>
          )),
        )}
      </ul>
      <p class="hint">Lengths are from tip to tip; tortuosity is the length over the straight way between the tips.</p>
    </section>
  );
}

export function tubeText({ tube_summary }: Tube): string {
  const { length_mm, radius_mm, diameter_mm, section_area_mm2, tortuosity } = tube_summary;
  const diameters = `${number(diameter_mm.p5, 1)} to ${number(diameter_mm.p95, 1)}`;
  return (
    `${number(length_mm, 1)} mm long, mean radius ${number(radius_mm.mean)} mm, ` +
    `mean diameter ${number(diameter_mm.mean)} mm (5 to 95 %: ${diameters}), ` +
    `mean section ${number(section_area_mm2.mean, 1)} mm², tortuosity ${number(tortuosity)}`
  );
}
