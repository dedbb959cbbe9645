/* SPDX-License-Identifier: BSD-3-Clause */
#include "apcbase.h"

#include <stdio.h>
#include <string.h>

static const struct {
    apc_status code;
    const char *name;
} names[] = {
    {APC_GOOD, "Good"},
    {APC_GOOD_LOCAL_OVERRIDE, "GoodLocalOverride"},
    {APC_GOOD_LIMITED_LOW, "GoodLimitedLow"},
    {APC_GOOD_LIMITED_HIGH, "GoodLimitedHigh"},
    {APC_GOOD_LIMITED_CONSTANT, "GoodLimitedConstant"},
    {APC_UNCERTAIN, "Uncertain"},
    {APC_UNCERTAIN_LAST_USABLE, "UncertainLastUsableValue"},
    {APC_UNCERTAIN_SUBSTITUTE, "UncertainSubstituteValue"},
    {APC_UNCERTAIN_INITIAL, "UncertainInitialValue"},
    {APC_UNCERTAIN_NOT_ACCURATE, "UncertainSensorNotAccurate"},
    {APC_BAD, "Bad"},
    {APC_BAD_NO_COMMUNICATION, "BadNoCommunication"},
    {APC_BAD_WAITING_FOR_INITIAL_DATA, "BadWaitingForInitialData"},
    {APC_BAD_OUT_OF_RANGE, "BadOutOfRange"},
    {APC_BAD_NOT_CONNECTED, "BadNotConnected"},
    {APC_BAD_DEVICE_FAILURE, "BadDeviceFailure"},
    {APC_BAD_SENSOR_FAILURE, "BadSensorFailure"},
    {APC_BAD_OUT_OF_SERVICE, "BadOutOfService"},
    {APC_BAD_NO_DATA, "BadNoData"},
};

enum apc_severity apc_status_severity(apc_status status)
{
    switch (status >> 30) {
    case 0:
        return APC_SEVERITY_GOOD;
    case 1:
        return APC_SEVERITY_UNCERTAIN;
    default:
        return APC_SEVERITY_BAD;
    }
}

char *apc_status_format(apc_status status, char text[APC_STATUS_NAME_LEN])
{
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (names[i].code == status)
            return memcpy(text, names[i].name, strlen(names[i].name) + 1);
    snprintf(text, APC_STATUS_NAME_LEN, "0x%08X", (unsigned)status);
    return text;
}

static int hex_digit(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    if (c >= 'A' && c <= 'F')
        return c - 'A' + 10;
    if (c >= 'a' && c <= 'f')
        return c - 'a' + 10;
    return -1;
}

static int parse_code(const char *text, apc_status *status)
{
    apc_status code = 0;
    if (text[0] != '0' || text[1] != 'x' || strlen(text) != 10)
        return APC_EINVAL;
    for (const char *c = text + 2; *c; c++) {
        int digit = hex_digit(*c);
        if (digit < 0)
            return APC_EINVAL;
        code = code << 4 | (apc_status)digit;
    }
    *status = code;
    return 0;
}

int apc_status_parse(const char *text, apc_status *status)
{
    if (!status)
        return APC_EINVAL;
    *status = APC_BAD;
    if (!text)
        return APC_EINVAL;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (!strcmp(names[i].name, text)) {
            *status = names[i].code;
            return 0;
        }
    if (!strcmp(text, "ok") || !strcmp(text, "'ok'")) {
        *status = APC_GOOD;
        return 0;
    }
    return parse_code(text, status);
}
