import { useEffect, useRef } from "preact/hooks";
import { token, tokenWanted } from "../api/client";

/** Asks for the token when the service wants one. It is kept in memory, never stored, never in the address. */
export function TokenDialog() {
  const dialog = useRef<HTMLDialogElement>(null);
  const input = useRef<HTMLInputElement>(null);
  const wanted = tokenWanted.value;
  useEffect(() => {
    if (wanted !== null && dialog.current?.open === false) dialog.current.showModal();
  }, [wanted]);
  const give = (event: SubmitEvent) => {
    event.preventDefault();
    const given = input.current?.value.trim() ?? "";
    if (input.current) input.current.value = "";
    tokenWanted.value = null;
    dialog.current?.close();
    if (given !== "") token.value = given;
  };
  return (
    <dialog ref={dialog} aria-labelledby="token-title" onClose={() => (tokenWanted.value = null)}>
      <form onSubmit={give}>
        <h2 id="token-title">Token</h2>
        <p>
          {token.value !== null && wanted ? `The token was refused: ${wanted.detail}.` : "This service wants a token."}
        </p>
        <label class="field">
          Token
          <input ref={input} type="password" autocomplete="off" spellcheck={false} required />
        </label>
        <p class="hint">
          It stays in the memory of this page until you close or reload it. The operator makes one with{" "}
          <code>medialrep token create</code>.
        </p>
        <div class="row">
          <button type="submit" class="primary">
            Go on
          </button>
          <button type="button" onClick={() => dialog.current?.close()}>
            Not now
          </button>
        </div>
      </form>
    </dialog>
  );
}
