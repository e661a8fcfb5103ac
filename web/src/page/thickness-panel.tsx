import { cssColorOf } from "../model/colors";
import { countedSurfaces, QUANTITIES, type Quantity, rangeOf, valuesOf } from "../model/quantity";
import type { ResultFigure } from "../model/result";
import type { Spread, Structure } from "../model/thickness";
import { type Bin, histogram } from "./histogram";
import { isTube, TubeList } from "./tube-list";
import type { View } from "./view";
import { number } from "./words";

const BINS = 24;
/** Of the drawing; it is scaled to the width there is. */
const [WIDTH, HEIGHT] = [240, 90];

/** How the area is spread over the values, the summary of each structure, and what tubes measure. */
export function ThicknessPanel({ view }: { view: View }) {
  const shown = view.numbers.structures.filter(
    ({ index, figures }) => figures.length > 0 && view.shownStructures.value.has(index),
  );
  return (
    <>
      <Histogram view={view} />
      <SummaryTable structures={shown} />
      <TubeList structures={shown} />
    </>
  );
}

function Histogram({ view }: { view: View }) {
  // Of what has no values there is no spread.
  const quantity = QUANTITIES[view.style.color.value].kind === "categorical" ? "total" : view.style.color.value;
  const { label, unit } = QUANTITIES[quantity];
  const range =
    quantity === view.style.color.value ? view.range.value : rangeOf(view.result, quantity, view.shownStructures.value);
  const bins = histogram(weighted(view, quantity), range, BINS);
  const decimals = Math.max(2, 1 - Math.floor(Math.log10(range[1] - range[0] || 1)));
  const most = Math.max(...bins.map(({ weight }) => weight), 1e-9);
  const all = bins.reduce((sum, { weight }) => sum + weight, 0);
  const bar = ({ from, to, weight }: Bin, at: number) => (
    <rect
      key={at}
      x={(at * WIDTH) / BINS}
      width={WIDTH / BINS - 1}
      y={HEIGHT - (HEIGHT * weight) / most}
      height={(HEIGHT * weight) / most}
      fill={cssColorOf(quantity, (from + to) / 2, range)}
    >
      <title>{`${number(from, decimals)} to ${number(to, decimals)}: ${number((100 * weight) / (all || 1), 1)} % of the area`}</title>
    </rect>
  );
  return (
    <figure class="histogram">
      <figcaption>
        {label}
        {unit && `, ${unit}`}: share of {areaName(view.shownFigures.value)}
      </figcaption>
      <svg
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        role="img"
        aria-label={`Histogram of ${label}; the table has the figures`}
      >
        {bins.map(bar)}
      </svg>
      <div class="row ends">
        <span>{number(range[0], decimals)}</span>
        <span>{number(range[1], decimals)}</span>
      </div>
    </figure>
  );
}

function weighted(view: View, quantity: Quantity) {
  return view.shownFigures.value.flatMap((figure) => {
    // A sheet has its area once and two sides; the wall of a tube is both of its sides.
    const share = figure.kind === "tube" && quantity !== "each" ? 0.5 : 1;
    return countedSurfaces(figure, quantity).flatMap((surface) =>
      valuesOf(figure, quantity, surface).flatMap((value, node) =>
        value === null ? [] : [{ value, weight: share * (figure.area_mm2?.[node] ?? 0) }],
      ),
    );
  });
}

function areaName(figures: readonly ResultFigure[]): string {
  const tubes = figures.filter(({ kind }) => kind === "tube");
  if (tubes.length === 0) return "the sheet's area";
  return tubes.length === figures.length ? "the wall's area" : "the area of sheets and walls";
}

function SummaryTable({ structures }: { structures: Structure[] }) {
  return (
    <section class="scroll" tabIndex={0} aria-label="Summary of thickness">
      <table>
        <caption>Thickness in mm, weighted by area</caption>
        <thead>
          <tr>
            <th scope="col">label</th>
            <th scope="col">side</th>
            <th scope="col">mean</th>
            <th scope="col">sd</th>
            <th scope="col">5 %</th>
            <th scope="col">50 %</th>
            <th scope="col">95 %</th>
            <th scope="col">area, mm²</th>
          </tr>
        </thead>
        <tbody>
          {structures.flatMap((structure) =>
            summaryRows(structure).map((row) => <SpreadRow key={`${structure.index} ${row.side}`} row={row} />),
          )}
        </tbody>
      </table>
    </section>
  );
}

interface SummaryRow {
  label: number;
  /** Another one in each row of a structure. */
  side: string;
  spread: Spread;
  area: number | null;
}

/** Both sides of all figures, each side of the sheets together, and each tube by itself. */
function summaryRows({ label, figures, thickness_summary }: Structure): SummaryRow[] {
  const { upper_mm, lower_mm, total_mm, area_mm2 } = thickness_summary;
  const rows: SummaryRow[] = [];
  const add = (side: string, spread: Spread | undefined, area: number | null) => {
    if (spread) rows.push({ label, side, spread, area });
  };
  add("both", total_mm, area_mm2);
  if (!figures.every(isTube)) {
    add("upper", upper_mm, null);
    add("lower", lower_mm, null);
  }
  const tubes = figures.filter(isTube);
  for (const { index, thickness_summary } of tubes) {
    const side = tubes.length > 1 ? `wall, figure ${index}` : "wall";
    add(side, thickness_summary.wall_mm, thickness_summary.area_mm2);
  }
  return rows;
}

function SpreadRow({ row: { label, side, spread, area } }: { row: SummaryRow }) {
  return (
    <tr class={side === "both" ? "both" : ""}>
      <th scope="row">{label}</th>
      <td>{side}</td>
      {[spread.mean, spread.sd, spread.p5, spread.p50, spread.p95].map((value, at) => (
        <td key={at}>{number(value)}</td>
      ))}
      <td>{area === null ? "" : number(area, 0)}</td>
    </tr>
  );
}
