/**
 * Client of cobot, a robot arm behind a REST service.
 *
 *     const robot = connect("http://localhost:8007");
 *     await robot.POST("/robot/move/named", { body: { name: "home", speed: 0.5 } });
 *
 * Paths, bodies and answers are those of the service's OpenAPI document, so a compiler checks them.
 * A motion is answered on arrival. Aborting its request (`signal`) stops the arm.
 */
import createClient, { type Client } from "openapi-fetch";

import type { paths } from "./service.js";

/** The service: endpoints of its default robot, and those of each robot below `/robots/{robot}`. */
export type Robot = Client<paths>;

export interface Options {
  /** A token made with `cobot token create`, for a service that requires one. */
  token?: string;
  /** Name of the user, for the log and the panel of a service without tokens. It proves nothing. */
  name?: string;
  /** Another implementation of `fetch`, for a proxy or certificates of its own. */
  fetch?: (request: Request) => Promise<Response>;
}

/** An error that the service reports, or a service that does not answer (code `unavailable`). */
export class CobotError extends Error {
  constructor(
    message: string,
    /** One of the codes in docs/services.md. */
    readonly code: string,
    /** HTTP status; 0 without an answer. */
    readonly status: number,
    /** The answer; of a motion that failed, with `explain` where there is more to say. */
    readonly body?: unknown,
    options?: ErrorOptions,
  ) {
    super(message, options);
    this.name = "CobotError";
  }
}

/**
 * A client for the service at `url`, such as `http://localhost:8007`.
 *
 * Each method throws `CobotError` for every answer that is not a success.
 */
export function connect(url: string, options: Options = {}): Robot {
  const headers: Record<string, string> = { Prefer: "status=strict" };
  if (options.token !== undefined) headers["Authorization"] = `Bearer ${options.token}`;
  if (options.name !== undefined) headers["X-Client-Name"] = encodeURIComponent(options.name);
  const base = url.replace(/\/+$/, "").replace(/\/v1$/, "");
  const robot = createClient<paths>({ baseUrl: `${base}/v1`, headers, fetch: options.fetch });
  robot.use({
    async onResponse({ response }) {
      if (!response.ok) throw await errorOf(response);
      return undefined;
    },
    onError({ error }) {
      if (error instanceof DOMException && error.name === "AbortError") return undefined;
      const why = error instanceof Error && error.cause instanceof Error ? error.cause.message : String(error);
      return new CobotError(`${base} does not answer: ${why}`, "unavailable", 0, undefined, { cause: error });
    },
  });
  return robot;
}

interface Report {
  code?: string | null;
  detail?: string;
  message?: string;
}

async function errorOf(response: Response): Promise<CobotError> {
  const text = await response.text();
  try {
    const report = JSON.parse(text) as Report;
    const message = report.detail ?? report.message;
    if (message !== undefined) return new CobotError(message, report.code ?? "error", response.status, report);
  } catch {
    // It is not JSON: something between the client and the service has answered.
  }
  return new CobotError(`HTTP ${response.status}, not from cobot: ${text.slice(0, 200)}`, "error", response.status, text);
}
