"""The roadmap: configurations drawn and connected, in CSR form."""
