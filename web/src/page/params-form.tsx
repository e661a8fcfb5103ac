import type { Field, Filled, Input, Variant } from "./params";

interface Props {
  fields: Field[];
  form: Record<string, Filled>;
  /** What is wrong, by field. */
  wrong: Record<string, string>;
  onChange(name: string, filled: Filled): void;
}

/** A row for each parameter: which way to give it, and its numbers. */
export function ParamsForm({ fields, form, wrong, onChange }: Props) {
  return (
    <div class="params">
      {fields.map((field) => (
        <ParamRow
          key={field.name}
          field={field}
          filled={form[field.name] ?? field.initial}
          wrong={wrong[field.name]}
          onChange={(filled) => onChange(field.name, filled)}
        />
      ))}
    </div>
  );
}

interface RowProps {
  field: Field;
  filled: Filled;
  wrong: string | undefined;
  onChange(filled: Filled): void;
}

function ParamRow({ field, filled, wrong, onChange }: RowProps) {
  const id = `param-${field.name}`;
  const variant = field.variants[filled.variant];
  const choose = (index: number) =>
    onChange({ variant: index, texts: index === field.initial.variant ? field.initial.texts : [] });
  const write = (at: number, text: string) => {
    const texts = inputsOf(variant).map((_, index) => filled.texts[index] ?? "");
    texts[at] = text;
    onChange({ ...filled, texts });
  };
  return (
    <fieldset class="param" aria-describedby={`${id}-about`}>
      <legend>{field.name}</legend>
      <div class="row">
        {field.variants.length > 1 && (
          <select
            aria-label={`${field.name}: how to set it`}
            value={filled.variant}
            onChange={(event) => choose(Number(event.currentTarget.value))}
          >
            {field.variants.map((way, index) => (
              <option key={way.label} value={index}>
                {way.label}
              </option>
            ))}
          </select>
        )}
        {inputsOf(variant).map((input, at) => (
          <input
            key={input.name}
            type="text"
            inputMode={input.isWhole ? "numeric" : "decimal"}
            aria-label={input.name === field.name ? field.name : `${field.name}: ${input.name}`}
            aria-invalid={wrong !== undefined}
            aria-describedby={wrong === undefined ? `${id}-about` : `${id}-wrong`}
            placeholder={placeholder(input)}
            value={filled.texts[at] ?? ""}
            onInput={(event) => write(at, event.currentTarget.value)}
          />
        ))}
      </div>
      {wrong !== undefined && (
        <p class="wrong" id={`${id}-wrong`}>
          {wrong}
        </p>
      )}
      <p class="hint" id={`${id}-about`}>
        {field.about}
      </p>
    </fieldset>
  );
}

/** The text inputs of a variant. */
function inputsOf(variant: Variant | undefined): Input[] {
  switch (variant?.kind) {
    case "number":
      return [variant.input];
    case "object":
      return variant.inputs;
    case "integers":
      return [{ name: "list", isWhole: false }];
    default:
      return [];
  }
}

function placeholder({ name, minimum, maximum }: Input): string {
  if (minimum === undefined || maximum === undefined) return name === "list" ? "11, 12" : name;
  return `${minimum} to ${maximum}`;
}
