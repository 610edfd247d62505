"""The kinds of stimuli, one file each; `stepblocks.parts.set.SHIPPED` lists them."""
