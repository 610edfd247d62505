"""STEP files as text: what stands in them, read without the kernel that wrote them."""
