/** The live feed: one WebSocket, opened again by itself; shows when it is gone. */
const QUIET_MS = 4000; // the server beats every second
const RETRY_MS = 1000;

export class Feed {
  /** `onReturn` is called when the server is there again after it was away. */
  constructor(store, onChange, onReturn) {
    this.store = store;
    this.onChange = onChange;
    this.onReturn = onReturn;
    this.connected = store.connected = false;
    this.lost = false;
    this.notes = [];
    this.since = Date.now();
    this.watched = "";
    this.receivedMs = 0;
    this.open();
    setInterval(() => {
      if (this.connected && Date.now() - this.receivedMs > QUIET_MS) this.socket.close();
    }, 1000);
  }

  open() {
    this.socket = new WebSocket(`ws://${location.host}/api/feed`);
    this.socket.onmessage = (event) => {
      this.receivedMs = Date.now();
      if (!this.connected) {
        this.connected = this.store.connected = true;
        this.send();
      }
      for (const entry of JSON.parse(event.data)) {
        if (entry.key === "dashboard/beat") {
          this.store.now = entry.message.wall_ns / 1e6;
          this.notes = entry.message.notes;
        } else if (entry.key === "dashboard/pulse") this.store.pulse(entry.message);
        else this.store.apply(entry);
      }
      if (this.lost) this.onReturn();
      this.lost = false;
      this.onChange();
    };
    this.socket.onclose = () => {
      if (this.connected) {
        this.since = Date.now();
        this.lost = true;
      }
      this.connected = false;
      this.onChange();
      setTimeout(() => this.open(), RETRY_MS);
    };
  }

  watch(name) {
    this.watched = name;
    this.send();
  }

  send() {
    if (this.connected && this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ watch: this.watched }));
  }
}
