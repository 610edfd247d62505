"""The junction of crown and tooth, as a bench block and as two bodies of revolution."""
