!> Where everything of the assembled scene stands, for pictures: frames and nodes of the bodies, the markers of joints, drives,
!> springs, forces and sensors. Written as figures of the summary, one line each; words are not added.
module scene_figures
  use growing_text, only: text_buffer
  use kinds, only: wp
  use deck_records, only: deck, marker_record
  use contact_pair, only: pair_measure
  use measure, only: measure_model
  use mechanism, only: mechanism_model
  use summary_text, only: json_number, summary_record
  use readable_text, only: json_text
  use text, only: either, to_text
  implicit none (type, external)
  private
  public :: add_scene

contains

  !> Adds the scene.
  subroutine add_scene(d, m, q, text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) assembled positions [m], [rad]
    type(summary_record), intent(inout) :: text
    integer :: k
    call text%open('scene', '{')
    call text%member('size', json_number(m%s%size))
    call text%member('gravity', vector(d%scene%gravity))
    call text%open('bodies', '[')
    do k = 1, size(d%bodies)
      call add_body(k)
    end do
    call text%close()
    call text%open('profiles', '[')
    do k = 1, size(d%profiles)
      call add_profile(k)
    end do
    call text%close()
    call text%open('joints', '[')
    do k = 1, size(d%joints)
      associate (r => d%joints(k))
        call begin_pair(r%name, r%type, r%a, r%b, r%direction)
        if (max(r%friction, r%friction_static, r%preload, r%preload_static) > 0.0_wp) call text%member('friction', &
                                                                                                      json_number(r%friction))
        call end_follower(r%profile, r%radius, r%face)
      end associate
    end do
    call text%close()
    call text%open('drives', '[')
    do k = 1, size(d%drives)
      call begin_pair(d%drives(k)%name, d%drives(k)%type, d%drives(k)%a, d%drives(k)%b, d%drives(k)%direction)
      call text%close()
    end do
    call text%close()
    call text%open('springs', '[')
    do k = 1, size(d%springs)
      call begin_pair(d%springs(k)%name, d%springs(k)%type, d%springs(k)%a, d%springs(k)%b, 0.0_wp)
      call text%close()
    end do
    call text%close()
    call text%open('stops', '[')
    do k = 1, size(d%stops)
      associate (r => d%stops(k))
        call begin_pair(r%name, r%type, r%a, r%b, r%direction)
        call text%member('lower', json_number(r%lower))
        call text%member('upper', json_number(r%upper))
        call end_follower(r%profile, r%radius, r%face)
      end associate
    end do
    call text%close()
    call text%open('forces', '[')
    do k = 1, size(d%forces)
      associate (r => d%forces(k))             ! as where their history is 1
        call begin_item(r%name, r%type)
        call text%member('at', marker(r%marker))
        call text%member('force', vector([r%fx, r%fy]))
        call text%member('axes', json_text(trim(r%axes)))
        call text%member('moment', json_number(r%moment))
        call text%member('centre', vector(r%centre))
        call text%close()
      end associate
    end do
    call text%close()
    call text%open('lumps', '[')
    do k = 1, size(d%lumps)
      call text%open('', '{')
      call text%member('at', marker(d%lumps(k)%marker))
      call text%member('mass', json_number(d%lumps(k)%mass))
      call text%close()
    end do
    call text%close()
    call text%open('sensors', '[')
    do k = 1, size(d%sensors)
      call begin_item(d%sensors(k)%name, d%sensors(k)%quantity)
      call text%member('at', marker(measured(k)))
      call text%close()
    end do
    call text%close()
    call text%close()
  contains
    !> The beginning of an item: its name and its kind.
    subroutine begin_item(name, kind)
      character(*), intent(in) :: name, kind
      call text%open('', '{')
      call text%member('name', json_text(trim(name)))
      call text%member('kind', json_text(trim(kind)))
    end subroutine begin_item

    !> The beginning of what acts between two markers, with its direction in global axes.
    subroutine begin_pair(name, kind, a, b, direction)
      character(*), intent(in) :: name, kind
      type(marker_record), intent(in) :: a, b
      real(wp), intent(in) :: direction        !! from the section of b [rad]
      call begin_item(name, kind)
      call text%member('a', marker(a))
      call text%member('b', marker(b))
      associate (at_b => pose(b))
        call text%member('direction', json_number(direction + at_b(3)))
      end associate
    end subroutine begin_pair

    !> The end of a joint or stop: where it follows a profile, its name, and a roller or a face (its angle from the section; null:
    !> none).
    subroutine end_follower(number, radius, face)
      integer, intent(in) :: number            !! of the profile, 0: none
      real(wp), intent(in) :: radius           !! [m]
      real(wp), intent(in) :: face             !! [rad]
      if (number > 0) then
        call text%member('profile', json_text(trim(d%profiles(number)%name)))
        call text%member('radius', json_number(radius))
        call text%member('face', json_number(face))
      end if
      call text%close()
    end subroutine end_follower

    !> A body: frame, nodes, elements; of a rigid body its mass centre.
    subroutine add_body(k)
      integer, intent(in) :: k                 !! body
      real(wp), allocatable :: places(:, :)    ! of nodes, then of the mass centre [m], [rad]
      integer :: j
      associate (b => m%s%bodies(k))
        allocate (places(3, b%nn + 1))
        do j = 1, b%nn
          places(:, j) = pose(marker_record(body=k, node=j))
        end do
        places(:, b%nn + 1) = pose(marker_record(body=k, point=b%i1/b%mass))
        call begin_item(d%bodies(k)%name, d%bodies(k)%kind)
        call text%member('frame', vector(q(m%s%qo(k) + 1:m%s%qo(k) + 3)))
        call text%member('mass', json_number(b%mass))
        call text%member('centre', vector(places(1:2, b%nn + 1)))
        call text%member('nodes', vectors(places(1:2, :b%nn)))
        call text%member('elements', vectors(real(b%en(:, :b%ne), wp)))
      end associate
      if (m%s%bodies(k)%layers%shown) call add_layers(k)
      call text%close()
    end subroutine add_body

    !> The sections of a body of layers, each layer between two heights above the node line, and the section of each element.
    subroutine add_layers(k)
      integer, intent(in) :: k                 !! body
      integer :: j, l
      associate (b => m%s%bodies(k)%layers)
        call text%open('sections', '[')
        do j = 1, size(b%sections)
          call text%open('', '[')
          do l = 1, size(b%sections(j)%layers)
            associate (layer => b%sections(j)%layers(l))
              call text%open('', '{')
              call text%member('material', json_text(trim(m%s%materials(layer%material))))
              call text%member('from', json_number(layer%height - 0.5_wp*layer%thickness))
              call text%member('to', json_number(layer%height + 0.5_wp*layer%thickness))
              call text%member('core', either('true', 'false', layer%core > 0))
              call text%member('viscoelastic', either('true', 'false', layer%follows))
              call text%close()
            end associate
          end do
          call text%close()
        end do
        call text%close()
        call text%member('element_sections', vector(real(b%kinds(b%kind)%section, wp)))
      end associate
    end subroutine add_layers

    !> A profile that some pair has: the points of its outline, in the axes of the section that carries it.
    subroutine add_profile(number)
      integer, intent(in) :: number            !! profile
      integer :: k
      k = findloc(d%joints%profile, number, 1)
      if (k > 0) then
        call outline(number, m%s%constraints(k)%item%measures(1)%item)
      else
        k = findloc(d%stops%profile, number, 1)
        if (k > 0) call outline(number, m%s%forces(m%s%springs + size(d%forces) + k)%item%measure)
      end if
    end subroutine add_profile

    !> Its line.
    subroutine outline(number, gap)
      integer, intent(in) :: number            !! profile
      class(measure_model), intent(in) :: gap
      select type (gap)
      class is (pair_measure)
        call begin_item(d%profiles(number)%name, d%profiles(number)%kind)
        call text%member('closed', either('true', 'false', d%profiles(number)%closed))
        call text%member('points', vectors(gap%profile%outline()))
        call text%close()
      end select
    end subroutine outline

    !> Where a sensor measures; those of joints, drives, springs and stops at their marker a.
    type(marker_record) function measured(k) result(at)
      integer, intent(in) :: k                 !! sensor
      associate (r => d%sensors(k))
        at = r%marker
        if (r%joint > 0) at = d%joints(r%joint)%a
        if (r%drive > 0) at = d%drives(r%drive)%a
        if (r%force > 0) at = d%forces(r%force)%marker
        if (r%spring > 0) at = d%springs(r%spring)%a
        if (r%stop > 0) at = d%stops(r%stop)%a
        if (r%element > 0) at%node = m%s%bodies(at%body)%en(1, r%element)
      end associate
    end function measured

    !> A marker: its body (null: the ground), its node (0: a point), where it is.
    function marker(r) result(json)
      type(marker_record), intent(in) :: r
      character(:), allocatable :: json
      json = 'null'
      if (r%body > 0) json = json_text(trim(d%bodies(r%body)%name))
      associate (x => pose(r))
        json = '{"body": '//json//', "node": '//to_text(r%node)//', "at": '//vector(x(1:2))//'}'
      end associate
    end function marker

    !> Position of a marker, and the angle of its section, of the frame where it has none.
    function pose(r) result(x)
      type(marker_record), intent(in) :: r
      real(wp) :: x(3)                         !! [m], [rad]
      real(wp) :: c, s
      x = [r%point, 0.0_wp]
      if (r%body == 0) return
      associate (b => m%s%bodies(r%body), frame => q(m%s%qo(r%body) + 1:m%s%qo(r%body) + 3))
        if (r%node > 0) x(1:2) = b%x(:, r%node)  ! assembly bends nothing
        c = cos(frame(3))
        s = sin(frame(3))
        x = frame + [c*x(1) - s*x(2), s*x(1) + c*x(2), x(3)]
      end associate
    end function pose
  end subroutine add_scene

  !> Numbers as a JSON list.
  function vector(x) result(json)
    real(wp), intent(in) :: x(:)               !! [m], [rad] or any other unit
    character(:), allocatable :: json
    type(text_buffer) :: words
    integer :: k
    do k = 1, size(x)
      call words%add(either('', ', ', k == 1)//json_number(x(k)))
    end do
    json = '['//words%all()//']'
  end function vector

  !> Columns of numbers as a list of lists.
  function vectors(x) result(json)
    real(wp), intent(in) :: x(:, :)            !! [m] or any other unit
    character(:), allocatable :: json
    type(text_buffer) :: words
    integer :: k
    do k = 1, size(x, 2)
      call words%add(either('', ', ', k == 1)//vector(x(:, k)))
    end do
    json = '['//words%all()//']'
  end function vectors
end module scene_figures
