#pragma once
#include "CoreMinimal.h"

class UActorComponent
{
public:
    typedef UActorComponent Super;
    virtual ~UActorComponent() = default;
    virtual void BeginPlay() {}
    virtual void EndPlay(const EEndPlayReason::Type) {}
};
