// Hands in several files that are dropped or chosen at once, a request for a few of them.
(limits => {
  const find = (event, selector) => event.target.closest && event.target.closest(selector);
  const hasEnded = file => file.__status !== 'idle' && file.__status !== 'uploading';
  const split = files => {  // into those of one request each
    const parts = [[]];
    let size = 0;
    for (const file of files) {
      if (parts.at(-1).length === limits.few || size + file.size > limits.bytes) {
        parts.push([]);
        size = 0;
      }
      parts.at(-1).push(file);
      size += file.size;
    }
    return parts;
  };
  const send = async (uploader, files) => {
    const field = getElement(Number(uploader.id.slice(1))).$refs.qRef;
    if (files.length > limits.files) {
      field.$emit('toomany', files.length);
      return;
    }
    let failed = 0;
    field.$emit('manybegin');
    for (const part of split(files)) {
      field.addFiles(part);
      while (!part.every(hasEnded)) await new Promise(go => setTimeout(go, 20));
      failed += part.filter(file => file.__status === 'failed').length;
      field.reset();
    }
    field.$emit('manyend', failed);
  };
  document.addEventListener('change', event => {
    const uploader = find(event, '.takes-many');
    if (!uploader || event.target.type !== 'file' || event.target.files.length < 2) return;
    event.stopPropagation();
    const files = [...event.target.files];
    event.target.value = '';
    send(uploader, files);
  }, true);
  document.addEventListener('drop', event => {
    const uploader = find(event, '.takes-many');
    if (!uploader || event.dataTransfer.files.length < 2) return;
    event.preventDefault();
    event.stopPropagation();
    event.target.dispatchEvent(new DragEvent('dragleave', { bubbles: true }));
    send(uploader, [...event.dataTransfer.files]);
  }, true);
})
