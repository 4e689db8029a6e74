// Search on pages that are opened from disk: browsers give these no workers, so a hidden frame does a worker's work.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.onmessage = null
      this.waiting = []
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      const address = new URL(url, document.baseURI).href.replaceAll('"', "%22")
      const answer = "self.postMessage = message => parent.postMessage(message, '*')"
      this.frame.srcdoc = `<!doctype html><script>${answer}<\/script><script src="${address}"><\/script>`
      this.frame.addEventListener("load", () => {
        const messages = this.waiting
        this.waiting = null
        messages.forEach(message => this.postMessage(message))
      })
      addEventListener("message", event => {
        if (event.source !== this.frame.contentWindow) return
        const told = new MessageEvent("message", { data: event.data })
        this.onmessage?.(told)
        this.dispatchEvent(told)
      })
      document.documentElement.append(this.frame)
    }
    postMessage(message) {
      if (this.waiting) this.waiting.push(message)
      else this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data: message }))
    }
    terminate() {
      this.frame.remove()
    }
  }
}
