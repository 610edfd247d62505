"""What is felt: critical angle, forces and vibration energy of a ball dragged over a surface."""
