"""The CAD kernel behind a narrow door: these modules alone import cadquery and OCP, and they alone think in millimetres."""
