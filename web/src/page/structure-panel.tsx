import type { Structure } from "../model/thickness";
import { VerdictBadge, verdictOf } from "./verdict";
import type { View } from "./view";
import { figureName, number, structureName } from "./words";

/** Which structures and figures are shown. */
export function StructurePanel({ view }: { view: View }) {
  const { structures } = view.numbers;
  const names = structures.map(({ index }) => `${index}`);
  return (
    <fieldset class="structures">
      <legend>Structures</legend>
      {structures.length > 1 && (
        <div class="row">
          <button type="button" onClick={() => view.style.setShown(names, true)}>
            All
          </button>
          <button type="button" onClick={() => view.style.setShown(names, false)}>
            None
          </button>
        </div>
      )}
      <ul>
        {structures.map((structure) => (
          <StructureRow key={structure.index} structure={structure} view={view} names={names} />
        ))}
      </ul>
    </fieldset>
  );
}

interface RowProps {
  structure: Structure;
  view: View;
  /** Of all structures. */
  names: string[];
}

function StructureRow({ structure, view, names }: RowProps) {
  const { index, figures, refusal, thickness_summary } = structure;
  const named = structureName(structure);
  const only = () => {
    view.style.showOnly(`${index}`, names);
    // The 3D view hears of it in the next frame.
    requestAnimationFrame(() => view.viewer.value?.fit());
  };
  return (
    <li>
      <div class="row">
        <Check view={view} name={`${index}`} label={named} />
        <VerdictBadge verdict={verdictOf(structure)} />
        <span class="hint">{figures.length > 0 && `${number(thickness_summary.total_mm?.mean, 1)} mm`}</span>
        {names.length > 1 && (
          <button type="button" class="small" onClick={only} aria-label={`Show only ${named}`}>
            only
          </button>
        )}
      </div>
      {refusal && <p class="hint">{refusal.message}</p>}
      {refusal?.hint && <p class="hint">{refusal.hint}</p>}
      {figures.length > 1 && (
        <div class="row figures">
          {figures.map((figure) => (
            <Check key={figure.index} view={view} name={`${index}/${figure.index}`} label={figureName(figure)} />
          ))}
        </div>
      )}
    </li>
  );
}

function Check({ view, name, label }: { view: View; name: string; label: string }) {
  return (
    <label class="check">
      <input
        type="checkbox"
        name={name}
        checked={!view.style.hidden.value.has(name)}
        onChange={(event) => view.style.setShown([name], event.currentTarget.checked)}
      />
      {label}
    </label>
  );
}
