// Search works from a folder too: browsers start no worker there, so that its script runs in a hidden frame.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      this.frame.srcdoc = "<body></body>"
      this.ready = new Promise((done) => {
        this.frame.onload = () => done(this.start(url))
      })
      document.body.append(this.frame)
    }

    async start(url) {
      const inside = this.frame.contentWindow
      const load = (from) =>
        new Promise((done) => {
          const script = inside.document.createElement("script")
          script.src = from
          script.onload = done
          inside.document.body.append(script)
        })
      inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }))
      inside.importScripts = async (...urls) => {
        for (const each of urls) await load(each)
      }
      await load(url)
      return inside
    }

    async postMessage(data) {
      const inside = await this.ready
      inside.dispatchEvent(new inside.MessageEvent("message", { data: structuredClone(data) }))
    }

    terminate() {
      this.frame.remove()
    }
  }
}
