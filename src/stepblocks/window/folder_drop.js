// Packs a folder that is dropped or chosen, and hands the archive to the field beside it.
// Files are stored as they are: a record before each, a list of them, and a record of the list
// (APPNOTE.TXT of the ZIP format, 4.3).
(limits => {
  const UTF_8 = 0x800;  // flag of names
  const BEGIN_OF_DATES = 0x21;  // 1980-01-01
  const table = Int32Array.from({ length: 256 }, (_, number) => {
    let rest = number;
    for (let bit = 0; bit < 8; bit++) rest = rest & 1 ? 0xedb88320 ^ (rest >>> 1) : rest >>> 1;
    return rest;
  });
  const sum = bytes => {
    let rest = -1;
    for (const byte of bytes) rest = table[(rest ^ byte) & 255] ^ (rest >>> 8);
    return (rest ^ -1) >>> 0;
  };
  const write = (...fields) => {  // each a number and its bytes, the lowest first
    const bytes = [];
    for (const [value, size] of fields) {
      for (let place = 0; place < size; place++) bytes.push(Math.floor(value / 256 ** place) & 255);
    }
    return new Uint8Array(bytes);
  };
  const pack = async files => {
    const total = files.reduce((size, found) => size + found.file.size, 0);
    const parts = [];
    const list = [];
    let place = 0;
    for (const { path, file } of files) {
      const name = new TextEncoder().encode(path);
      // one that is too large is refused by its size, whatever its sums are
      const check = total > limits.bytes ? 0 : sum(new Uint8Array(await file.arrayBuffer()));
      const described = [[20, 2], [UTF_8, 2], [0, 2], [0, 2], [BEGIN_OF_DATES, 2], [check, 4],
        [file.size, 4], [file.size, 4], [name.length, 2], [0, 2]];
      const record = write([0x04034b50, 4], ...described);
      parts.push(record, name, file);
      list.push(write([0x02014b50, 4], [20, 2], ...described, [0, 2], [0, 2], [0, 2], [0, 4],
        [place, 4]), name);
      place += record.length + name.length + file.size;
    }
    const size = list.reduce((length, bytes) => length + bytes.length, 0);
    const end = write([0x06054b50, 4], [0, 2], [0, 2], [files.length, 2], [files.length, 2],
      [size, 4], [place, 4], [0, 2]);
    return new Blob([...parts, ...list, end], { type: 'application/zip' });
  };
  const collect = async (folder, path, found) => {
    const reader = folder.createReader();
    for (;;) {
      const entries = await new Promise((take, fail) => reader.readEntries(take, fail));
      if (entries.length === 0) return;
      for (const entry of entries) {
        if (found.length > limits.files) return;
        if (entry.isDirectory) {
          await collect(entry, `${path}${entry.name}/`, found);
        } else {
          const file = await new Promise((take, fail) => entry.file(take, fail));
          found.push({ path: path + entry.name, file });
        }
      }
    }
  };
  const send = async (uploader, name, find) => {
    const field = getElement(Number(uploader.id.slice(1))).$refs.qRef;
    try {
      const archive = await pack(await find());
      field.addFiles([new File([archive], `${name}.zip`, { type: archive.type })]);
    } catch (error) {
      console.warn(error);
      field.$emit('unread');
    }
  };
  document.addEventListener('drop', event => {
    const uploader = event.target.closest('.takes-folders');
    if (!uploader) return;
    const entries = [...event.dataTransfer.items].map(item => item.webkitGetAsEntry());
    const folder = entries.find(entry => entry && entry.isDirectory);
    if (!folder) return;
    event.preventDefault();
    event.stopPropagation();
    event.target.dispatchEvent(new DragEvent('dragleave', { bubbles: true }));
    send(uploader, folder.name, async () => {
      const found = [];
      await collect(folder, '', found);
      return found;
    });
  }, true);
  window.sendChosenFolder = (input, id) => {
    const chosen = [...input.files].slice(0, limits.files + 1);
    input.value = '';
    if (chosen.length === 0) return;
    const name = chosen[0].webkitRelativePath.split('/')[0];
    send(document.getElementById(id), name, async () => chosen.map(file =>
      ({ path: file.webkitRelativePath.slice(name.length + 1), file })));
  };
})
