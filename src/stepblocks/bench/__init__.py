"""A measured session in, features out: each trace screened and measured, with uncertainties."""
