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
    /* what others' servers say, and nobody here */
    {0x002F0000, "GoodOverload"},
    {0x00300000, "GoodClamped"},
    {0x40950000, "UncertainSubNormal"},
    {0x40A40000, "UncertainDataSubNormal"},
    {0x80010000, "BadUnexpectedError"},
    {0x80020000, "BadInternalError"},
    {0x80030000, "BadOutOfMemory"},
    {0x80040000, "BadResourceUnavailable"},
    {0x80050000, "BadCommunicationError"},
    {0x80060000, "BadEncodingError"},
    {0x80070000, "BadDecodingError"},
    {0x800A0000, "BadTimeout"},
    {0x800C0000, "BadShutdown"},
    {0x800D0000, "BadServerNotConnected"},
    {0x800E0000, "BadServerHalted"},
    {0x80130000, "BadSecurityChecksFailed"},
    {0x801F0000, "BadUserAccessDenied"},
    {0x80330000, "BadNodeIdInvalid"},
    {0x80340000, "BadNodeIdUnknown"},
    {0x80350000, "BadAttributeIdInvalid"},
    {0x80360000, "BadIndexRangeInvalid"},
    {0x80370000, "BadIndexRangeNoData"},
    {0x803A0000, "BadNotReadable"},
    {0x803D0000, "BadNotSupported"},
    {0x803E0000, "BadNotFound"},
    {0x80400000, "BadNotImplemented"},
    {0x80740000, "BadTypeMismatch"},
    {0x80890000, "BadConfigurationError"},
    {0x809D0000, "BadDataLost"},
    {0x809E0000, "BadDataUnavailable"},
    {0x80AE0000, "BadConnectionClosed"},
    {0x80AF0000, "BadInvalidState"},
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
