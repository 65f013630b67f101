!> What assembly found, and its words.
module assembly_reports
  use kinds, only: wp
  use mechanism, only: mechanism_model
  use text, only: es_text
  implicit none (type, external)
  private
  public :: assembly_report, add_warning, open_joints

  character(*), parameter, public :: too_uneven = 'the masses along the joints are too uneven for double precision (heavy '// &
                                                  'bodies that hang on light ones, beyond ratios of about 1e15 in all)'

  !> What assembly found.
  type :: assembly_report
    integer :: rank = 0                             !! independent constraint rows
    integer :: freedoms = 0                         !! degrees of freedom
    logical, allocatable :: dependent(:)            !! (constraints) takes part in a redundant set
    character(:), allocatable :: warnings(:)        !! one sentence each
    logical :: open = .false.                       !! positions that close all joints were not found
    integer :: newton = 0                           !! position steps taken
  end type assembly_report

contains

  !> Adds a warning.
  subroutine add_warning(report, text)
    type(assembly_report), intent(inout) :: report
    character(*), intent(in) :: text
    character(:), allocatable :: longer(:)
    integer :: n
    n = size(report%warnings)
    allocate (character(max(len(report%warnings), len(text))) :: longer(n + 1))
    longer(1:n) = report%warnings
    longer(n + 1) = text
    call move_alloc(longer, report%warnings)
  end subroutine add_warning

  !> Names of the joints and drives whose rows do not hold, with how far they stay open.
  function open_joints(self, row, limit, unit) result(text)
    type(mechanism_model), intent(in) :: self
    real(wp), intent(in) :: row(:)             !! (rows) Phi [m] or its rate [m/s]
    real(wp), intent(in) :: limit              !! up to which a row holds [m] or [m/s]
    character(*), intent(in) :: unit
    character(:), allocatable :: text
    real(wp) :: gap
    integer :: k
    text = ''
    do k = 1, size(self%s%constraints)
      associate (c => self%s%constraints(k)%item)
        gap = maxval(abs(row(c%first:c%first + c%rows - 1)))
        if (gap <= limit) cycle
        if (len(text) > 0) text = text//', '
        text = text//merge('drive ', 'joint ', c%drive)//'"'//trim(c%name)//'" stays open by '//trim(adjustl(es_text(gap, 2)))// &
               ' '//unit
      end associate
    end do
  end function open_joints
end module assembly_reports
