// What is dropped on the page: sent, read by the server, and then replayed or looked up.

import { show } from "./address.js";
import { columns, json } from "./api.js";
import { by, say } from "./elements.js";

const MOST = 200e6; // bytes
const IMAGES = /\.(pgm|png|bmp|jpe?g)$/i, MAPS = /\.ya?ml$/i;
const PLAIN = { "Content-Type": "application/octet-stream" };

export class Uploads {
  constructor(page) {
    this.page = page;
    by("file").addEventListener("change", () => { this.send([...by("file").files]); by("file").value = ""; });
    let depth = 0;
    addEventListener("dragenter", (event) => { event.preventDefault(); depth++; by("drop").hidden = false; });
    addEventListener("dragleave", () => { if (--depth <= 0) { depth = 0; by("drop").hidden = true; } });
    addEventListener("dragover", (event) => event.preventDefault());
    addEventListener("drop", (event) => {
      event.preventDefault();
      depth = 0;
      by("drop").hidden = true;
      this.send([...event.dataTransfer.files]);
    });
  }

  async send(files) {
    const images = files.filter((file) => IMAGES.test(file.name));
    for (const file of files.filter((one) => !IMAGES.test(one.name))) {
      try {
        if (file.size > MOST) throw new Error(`${file.name} is larger than 200 MB; index it with m2t-text index`);
        this.page.replay.receiving(file.name);
        let upload = await this.post("/api/uploads", { name: file.name, index: this.page.index }, file);
        if (upload.needs) {
          const image = images.find((one) => one.name === upload.needs);
          if (!image) throw new Error(`${file.name} needs its image ${upload.needs}: drop both at once`);
          upload = await this.post(`/api/uploads/${upload.id}/${encodeURIComponent(upload.needs)}`, { index: this.page.index }, image, "PUT");
        }
        show({ drive: upload.id, at: null, q: null, where: null });
      } catch (error) { this.page.replay.failed(error.message); say(error.message); }
    }
  }

  post(path, parameters, file, method = "POST") {
    return json(path, parameters, { method, body: file, headers: PLAIN });
  }

  places(id) { return columns(`/api/uploads/${id}/places`, { index: this.page.index }); }
}
