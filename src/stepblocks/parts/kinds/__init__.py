"""The kinds of stimuli, one file each: what is declared, and all that follows from it; `stepblocks.parts.set.SHIPPED` lists them."""
