"""Forces at a kilohertz: renderer, devices, servo, hands, and the page to feel."""
