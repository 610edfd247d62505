"""Designs: who judges which block when, their run sheets, and simulated participants."""
