"""What a workshop is sent besides the STEP file: drawings, inspection sheets, routes."""
