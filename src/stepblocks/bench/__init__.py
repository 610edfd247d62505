"""What was felt: a measured session read in, each trace screened and measured, with uncertainties."""
