"""What the model lacks: a session in; residual, effect, error before and after, out.

1. From features to trials: `columns`, `usable_trials`, `block_scans`, `session_table`.
2. The model that `stepblocks.lawsearch` compares with them: `bench_model`, and `heights` of blocks.
3. One session, several, and one that is only planned: `run`, `several`, `rehearsal`.
4. What is written: `record` (the contents of result.json), which `compose` fills; `apart` and
   `experiment` (trials that went wrong, and what to measure next, with its `settings`); `finding`
   (one sentence), `page` and `figures`; `words` and `channels` are the terms of all of them.
"""
