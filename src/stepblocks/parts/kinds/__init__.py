"""The kinds of stimuli, one file each; `stepblocks.declaration.set.SHIPPED` lists them."""
