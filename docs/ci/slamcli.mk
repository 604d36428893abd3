# Regression suites in a Makefile. Copy this file, then:
#
#     SLAMCLI_SUITE := ci/suite.yaml
#     include slamcli.mk
#
#     make slam-regress     compares the suite with its baseline
#     make slam-report      the same, with an HTML report
#     make slam-bless       makes what is measured now the baseline, and shows what changes
#
# ARGS="--only 'sphere*'" is passed on.

SLAMCLI ?= slamcli
SLAMCLI_SUITE ?= ci/suite.yaml
SLAMCLI_REPORT ?= slam-report.html

# what a plain make does is left to the Makefile that includes this
SLAMCLI_GOAL := $(.DEFAULT_GOAL)

.PHONY: slam-regress slam-report slam-bless

slam-regress:
	$(SLAMCLI) regress $(SLAMCLI_SUITE) $(ARGS)

slam-report:
	$(SLAMCLI) regress $(SLAMCLI_SUITE) -o $(SLAMCLI_REPORT) $(ARGS)

slam-bless:
	$(SLAMCLI) regress $(SLAMCLI_SUITE) --update-baseline $(ARGS)

.DEFAULT_GOAL := $(SLAMCLI_GOAL)
