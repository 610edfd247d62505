// Unreal component for libstepblocks: add the library and stepblocks.h to a module of your project
// (PublicAdditionalLibraries, PublicIncludePaths), and this file and StepBlocksComponent.cpp to its
// source.
//
// The servo runs in a thread of its own; the game reads a copy of the last tick. Unreal is
// left-handed, z up, centimetres: a part's (x, y, z) [m] is Unreal's 100 (x, -y, z) [cm].
#pragma once

#include "Components/ActorComponent.h"
#include "CoreMinimal.h"
#include "HAL/Runnable.h"
#include "stepblocks.h"
#include <atomic>

#include "StepBlocksComponent.generated.h"

class FRunnableThread;

// What a device must do; implement it for yours.
class IStepBlocksDevice
{
public:
    virtual ~IStepBlocksDevice() = default;
    virtual void Read(double Hand[3], double Velocity[3]) = 0;  // [m], [m/s], axes of the part
    virtual void Write(const double Force[3]) = 0;              // [N], axes of the part
};

UCLASS(ClassGroup = (Haptics), meta = (BlueprintSpawnableComponent))
class UStepBlocksComponent : public UActorComponent, public FRunnable
{
    GENERATED_BODY()

public:
    UPROPERTY(EditAnywhere, Category = "StepBlocks")
    FString Blocks;  // path of blocks.txt

    UPROPERTY(EditAnywhere, Category = "StepBlocks")
    double Rate = 1000.0;  // ticks per second

    UPROPERTY(EditAnywhere, Category = "StepBlocks")
    double ForceLimit = -1.0;  // [N]; below zero that of the file

    UPROPERTY(EditAnywhere, Category = "StepBlocks")
    double Rise = 1.0;  // in which the force grows after the start [s]

    UPROPERTY(EditAnywhere, Category = "StepBlocks")
    bool bTooth = false;  // the file is a whole tooth: hand and force are in the axes of the scan

    IStepBlocksDevice* Device = nullptr;  // set it before BeginPlay

    UFUNCTION(BlueprintCallable, Category = "StepBlocks")
    bool Choose(const FString& Name);

    UFUNCTION(BlueprintCallable, Category = "StepBlocks")
    FVector Tip() const;  // [cm]

    sb_output Last() const;

    virtual void BeginPlay() override;
    virtual void EndPlay(const EEndPlayReason::Type Reason) override;
    virtual uint32 Run() override;

private:
    sb_world* World = nullptr;
    FRunnableThread* Thread = nullptr;
    std::atomic<bool> bRunning{false};
    std::atomic<int> Wanted{-1};
    mutable FCriticalSection Gate;
    sb_output Shown = {};
};
