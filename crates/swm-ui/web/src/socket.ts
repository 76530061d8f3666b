// The connection of a live environment.

export interface Ending { steps: number; success: boolean | null; total_reward: number }
export interface Recording { file: string; id: string; in_file: number; waiting: Ending | null }
export interface Point { step: number; reward: number | null; cost: number | null; values: (number | null)[] }
export interface Size { height: number; width: number }
export interface Head extends Size {
  playing: boolean; actor: string; episode: number; step: number;
  over: "terminated" | "truncated" | null; success: boolean | null; total_reward: number | null;
  recording: Recording | null; agent: [number, number] | null; points: Point[];
}
/** Who acts in a pair of a receipt: its policy, one of its reference policies, or the oracle. */
export type Run = "policy" | "oracle" | { reference: number };
/** What a planner thought: points are fractions of the image's width and height, by object. */
export interface Plan {
  kind: "plan"; step: number; objects: string[]; costs: (number | null)[][]; cost: number | null; true_cost: number | null;
  agreement: number | null; paths: Path[];
}
export interface Path {
  of: "candidate" | "first elite" | "last elite" | "plan"; cost: number | null; true_cost: number | null; objects: [number, number][][];
}
export type Message =
  | { kind: "error"; text: string }
  | { kind: "opened"; env: string; hz: number; steer: object | null; policy: string | null }
  | { kind: "episode"; seed: number; episode: number; factors: Record<string, unknown> }
  | { kind: "plotted"; names: string[] }
  | Plan
  | { kind: "recorded"; id: string | null };

export interface Listener {
  frame(head: Head, rgb: Uint8Array): void;
  goal(size: Size, rgb: Uint8Array): void;
  /** The episode up to now as a file. */
  video(extension: string, content: Blob): void;
  message(message: Message): void;
  opened(): void;
  closed(reason: string): void;
}

export class Socket {
  private socket: WebSocket;
  private waiting: string[] = [];

  constructor(listener: Listener) {
    this.socket = new WebSocket(`ws://${location.host}/api/play`);
    this.socket.binaryType = "arraybuffer";
    let wasOpen = false;
    this.socket.onopen = () => {
      wasOpen = true;
      this.waiting.forEach((text) => this.socket.send(text));
      this.waiting = [];
      listener.opened();
    };
    this.socket.onmessage = ({ data }) => {
      if (typeof data === "string") {
        listener.message(JSON.parse(data));
        return;
      }
      const size = new DataView(data).getUint32(0, true);
      const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size)));
      const rgb = new Uint8Array(data, 4 + size);
      if (head.goal) listener.goal(head, rgb);
      else if (head.video) listener.video(head.video, new Blob([rgb], { type: head.video === "mp4" ? "video/mp4" : "image/gif" }));
      else {
        listener.frame(head, rgb);
        this.send({ type: "shown" });
      }
    };
    this.socket.onclose = ({ reason }) => {
      listener.closed(reason || (wasOpen
        ? "The connection is gone: the server has ended. Start `swm ui` again."
        : "No environment could be opened: as many are open as the server allows, or it has ended."));
    };
  }

  send(message: object) {
    const text = JSON.stringify(message);
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(text);
    else if (this.socket.readyState === WebSocket.CONNECTING) this.waiting.push(text);
  }

  close() {
    const { socket } = this;
    socket.onclose = socket.onmessage = null;
    // Browsers complain of a connection that is closed before it is open.
    if (socket.readyState === WebSocket.CONNECTING) socket.onopen = () => socket.close();
    else socket.close();
  }
}
