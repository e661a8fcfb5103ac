/** A form's fields from the JSON Schema of the parameters, and the parameters from what was filled in. */

/** The part of JSON Schema that parameters are described with. */
export interface Schema {
  type?: string;
  enum?: string[];
  oneOf?: Schema[];
  properties?: Record<string, Schema>;
  minimum?: number;
  maximum?: number;
  maxItems?: number;
  default?: unknown;
  description?: string;
}

/** One way to give a parameter. */
export type Variant =
  | { kind: "constant"; label: string; value: unknown }
  | { kind: "number"; label: string; input: Input }
  | { kind: "object"; label: string; inputs: Input[] }
  | { kind: "integers"; label: string; most: number };

export interface Input {
  name: string;
  isWhole: boolean;
  minimum?: number;
  maximum?: number;
}

export interface Field {
  name: string;
  about: string;
  variants: Variant[];
  initial: Filled;
}

/** What stands in a field: which variant, and the text of its inputs. */
export interface Filled {
  variant: number;
  texts: string[];
}

/** Leaves a parameter out, for the service to choose. */
const LEFT_OUT: Variant = { kind: "constant", label: "not set", value: undefined };

export function fieldsOf(schema: Schema): Field[] {
  return Object.entries(schema.properties ?? {}).map(([name, property]) => {
    const hasDefault = property.default !== undefined;
    const variants = [...(hasDefault ? [] : [LEFT_OUT]), ...variantsOf(name, property)];
    return { name, about: property.description ?? "", variants, initial: fill(variants, property.default) };
  });
}

function variantsOf(name: string, schema: Schema): Variant[] {
  if (schema.enum !== undefined) return schema.enum.map((value) => ({ kind: "constant", label: value, value }));
  if (schema.type === "number" || schema.type === "integer") {
    return [
      { kind: "number", label: schema.type === "integer" ? "a whole number" : "a number", input: input(name, schema) },
    ];
  }
  if (schema.type === "array") return [{ kind: "integers", label: "these", most: schema.maxItems ?? Infinity }];
  if (schema.properties !== undefined) {
    const inputs = Object.entries(schema.properties).map(([key, part]) => input(key, part));
    return [{ kind: "object", label: inputs.map((input) => input.name).join(" and "), inputs }];
  }
  return (schema.oneOf ?? []).flatMap((one) => variantsOf(name, one));
}

function input(name: string, { type, minimum, maximum }: Schema): Input {
  return {
    name,
    isWhole: type === "integer",
    ...(minimum === undefined ? {} : { minimum }),
    ...(maximum === undefined ? {} : { maximum }),
  };
}

/** How `value` stands in a field with these variants. */
function fill(variants: Variant[], value: unknown): Filled {
  for (const [variant, way] of variants.entries()) {
    if (way.kind === "constant" && way.value === value) return { variant, texts: [] };
    if (way.kind === "number" && typeof value === "number") return { variant, texts: [String(value)] };
    if (way.kind === "object" && isRecord(value) && way.inputs.every((input) => input.name in value)) {
      return { variant, texts: way.inputs.map((input) => String(value[input.name])) };
    }
  }
  return { variant: 0, texts: [] };
}

function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

type Read = { value: unknown } | { wrong: string };

/** The value of a field, or what is wrong with what was filled in. */
function read(field: Field, filled: Filled): Read {
  const variant = field.variants[filled.variant];
  switch (variant?.kind) {
    case "number":
      return readNumber(variant.input, filled.texts[0]);
    case "object": {
      const values: Record<string, unknown> = {};
      for (const [at, input] of variant.inputs.entries()) {
        const read = readNumber(input, filled.texts[at]);
        if ("wrong" in read) return read;
        values[input.name] = read.value;
      }
      return { value: values };
    }
    case "integers":
      return readIntegers(filled.texts[0] ?? "", variant.most);
    default:
      return { value: variant?.value };
  }
}

function readNumber({ name, isWhole, minimum, maximum }: Input, text = ""): Read {
  // A comma of decimals; in whole numbers it may be one of thousands, which is asked back.
  const value = Number(isWhole ? text : text.replace(",", "."));
  const bounds = `${name}: ${isWhole ? "a whole number" : "a number"} from ${minimum ?? "−∞"} to ${maximum ?? "∞"}`;
  const isFit =
    /^\s*[+-]?[\d.,]+(e[+-]?\d+)?\s*$/i.test(text) && Number.isFinite(value) && (!isWhole || Number.isInteger(value));
  return isFit && value >= (minimum ?? -Infinity) && value <= (maximum ?? Infinity) ? { value } : { wrong: bounds };
}

function readIntegers(text: string, most: number): Read {
  const parts = text.split(/[\s,;]+/).filter((part) => part !== "");
  const values = parts.map(Number);
  const isFit =
    values.length > 0 && values.length <= most && values.every((value) => Number.isInteger(value) && value !== 0);
  return isFit ? { value: values } : { wrong: `whole numbers other than 0, at most ${most}, separated by commas` };
}

/** The parameters that differ from what the service would take anyway; what is wrong, by field. */
export function assemble(fields: Field[], form: Record<string, Filled>) {
  const params: Record<string, unknown> = {};
  const wrong: Record<string, string> = {};
  for (const field of fields) {
    const given = read(field, form[field.name] ?? field.initial);
    const untouched = read(field, field.initial);
    if ("wrong" in given) wrong[field.name] = given.wrong;
    else if (JSON.stringify(given) !== JSON.stringify(untouched)) params[field.name] = given.value;
  }
  return { params, wrong };
}
