!> Reduced structures in files beside their models, so that a second run need not factorise again: `plate.h5.1a2b3c4d.reduced`.
!>
!> The name holds a checksum of all that the structure was made from, the file the whole mark of it and a checksum of its own
!> numbers. A file that is damaged or of something else is as good as none. It is written under another name and then renamed, so
!> that processes which make the same one at the same time do no harm.
module hb_reduction_file
   use hb_checksum, only: checksum
   use hb_error, only: error_t, fail
   use hb_hdf5, only: create_in_memory, h5_dataset_t, h5_file_t, open_file
   use hb_kinds, only: wp
   use hb_node_sets, only: direction_length, name_length
   use hb_structure, only: label_length, new_structure, reach_t, structure_t, unit_length
   use hb_system, only: file_kind, kind_of_file, process_id, remove_file, rename_file
   use hb_text, only: to_text
   implicit none
   private
   public :: read_reduction, reduction_path, write_reduction

   character(*), parameter :: format_name = "nhbm reduction 1"

contains

   !> Path of the file for a model and a mark.
   function reduction_path(model, mark) result(path)
      character(*), intent(in) :: model                               !! path of the model
      integer, intent(in) :: mark(:)                                  !! of all that the structure was made from
      character(:), allocatable :: path
      character(8) :: number

      write (number, "(z8.8)") checksum(0, mark)
      path = model//"."//number//".reduced"
   end function reduction_path

   !> Writes a reduced structure and how its full one follows from it; leaves no file where that is not possible.
   subroutine write_reduction(model, mark, structure, recovery)
      character(*), intent(in) :: model
      integer, intent(in) :: mark(:)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: recovery(:, :)                          !! (structure%n_dofs, degrees of freedom of the full one)
      type(h5_file_t) :: file
      type(error_t), allocatable :: error, ignored
      character(:), allocatable :: path, temporary
      logical :: is_there

      path = reduction_path(model, mark)
      if (all(kind_of_file(path) /= [file_kind%none, file_kind%regular, file_kind%empty])) return
      temporary = path//"."//to_text(process_id())//".part"
      call create_in_memory(file, path, error)                        ! a full disk costs the file, not the run
      if (allocated(error)) return
      call write_parts(file, mark, structure, recovery, error)
      if (.not. allocated(error)) call file%save(temporary, error)
      call file%close(ignored)
      if (allocated(error)) return
      call rename_file(temporary, path, is_there)
      if (.not. is_there) call remove_file(temporary)
   end subroutine write_reduction

   subroutine write_parts(file, mark, structure, recovery, error)
      type(h5_file_t), intent(in) :: file
      integer, intent(in) :: mark(:)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: recovery(:, :)
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t) :: none(0)
      real(wp) :: figures(5)

      figures = [real(structure%reduction%n_full, wp), structure%reduction%reach%up_to, structure%reduction%error, &
                 structure%reduction%seconds, structure%reduction%bytes]
      call file%set_attribute("format", format_name, error)
      if (allocated(error)) return
      call file%put("mark", mark, none, "1", "what the structure was made from", error)
      call file%put("sum", [sum_of(structure, figures)], none, "1", "checksum of the numbers", error)
      call file%put("figures", figures, none, "1", "degrees of freedom before, highest frequency, error, seconds, bytes", error)
      call file%put("mass", structure%mass, none, "kg", "mass", error)
      call file%put("damping", structure%damping, none, "N s/m", "damping", error)
      call file%put("stiffness", structure%stiffness, none, "N/m", "stiffness", error)
      call file%put("recovery", recovery, none, "1", "degrees of freedom of the model by those here", error)
      call put_texts("labels", structure%labels)
      call put_texts("units", structure%units)
      associate (sets => structure%sets, vectors => structure%vectors)
         if (allocated(sets%names)) then
            call put_texts("set_names", sets%names)
            call file%put("set_first", sets%first, none, "1", "sets of nodes", error)
            call file%put("set_nodes", sets%nodes, none, "1", "sets of nodes", error)
            call file%put("node_of", sets%node_of, none, "1", "node of each degree of freedom", error)
            call put_texts("direction", sets%direction)
         end if
         if (allocated(vectors%names)) then
            call put_texts("vector_names", vectors%names)
            call file%put("vector_first", vectors%first, none, "1", "vectors of loads", error)
            call file%put("vector_dofs", vectors%dofs, none, "1", "vectors of loads", error)
            call file%put("vector_values", vectors%values, none, "N", "vectors of loads", error)
         end if
      end associate

   contains

      subroutine put_texts(name, values)
         character(*), intent(in) :: name
         character(*), intent(in) :: values(:)
         type(h5_dataset_t) :: dataset

         if (allocated(error) .or. size(values) == 0) return
         call file%add_texts(name, values, dataset, error)
         call dataset%close()
      end subroutine put_texts
   end subroutine write_parts

   !> Reads the reduced structure of a model and a mark, if there is a sound file of it.
   subroutine read_reduction(model, mark, structure, is_found, trouble)
      character(*), intent(in) :: model
      integer, intent(in) :: mark(:)
      type(structure_t), intent(inout) :: structure                   !! stays where nothing is found
      logical, intent(out) :: is_found
      character(:), allocatable, intent(out) :: trouble               !! which file is there and of no use, and why
      type(h5_file_t) :: file
      type(error_t), allocatable :: error, ignored
      type(structure_t) :: found

      is_found = kind_of_file(reduction_path(model, mark)) == file_kind%regular
      if (.not. is_found) return
      call open_file(file, reduction_path(model, mark), error)
      if (.not. allocated(error)) then
         call read_parts(file, mark, found, error)
         call file%close(ignored)
      end if
      is_found = .not. allocated(error)
      if (is_found) then
         structure = found
      else
         trouble = reduction_path(model, mark)//": "//error%message
      end if
   end subroutine read_reduction

   subroutine read_parts(file, mark, structure, error)
      type(h5_file_t), intent(in) :: file
      integer, intent(in) :: mark(:)
      type(structure_t), intent(inout) :: structure
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: form, labels(:), units(:), words(:)
      integer, allocatable :: of_file(:), sum(:)
      real(wp), allocatable :: damping(:, :), figures(:), mass(:, :), stiffness(:, :)

      call file%get_attribute("format", form, error)
      if (allocated(error)) return
      call file%get("mark", of_file, error)
      call file%get("sum", sum, error)
      call file%get("figures", figures, error)
      call file%get("labels", labels, error)
      call file%get("units", units, error)
      call read_matrix("mass", mass)
      call read_matrix("damping", damping)
      call read_matrix("stiffness", stiffness)
      if (allocated(error)) return
      if (form /= format_name .or. size(of_file) /= size(mark) .or. size(sum) /= 1 .or. size(figures) /= 5 .or. &
          size(units) /= size(labels) .or. .not. file%has("recovery")) then
         call fail(error, "is of another form")
      else if (any(of_file /= mark)) then
         call fail(error, "is of something else")
      end if
      if (allocated(error)) return
      call new_structure(structure, mass, damping, stiffness, labels, units, error)
      if (allocated(error)) return
      associate (sets => structure%sets, vectors => structure%vectors)
         if (file%has("node_of")) then
            allocate (sets%names(0), sets%nodes(0))
            if (file%has("set_names")) then
               call file%get("set_names", words, error)
               if (allocated(words)) sets%names = padded(words, name_length)
            end if
            call file%get("set_first", sets%first, error)
            call file%get("set_nodes", sets%nodes, error)
            call file%get("node_of", sets%node_of, error)
            call file%get("direction", words, error)
            if (allocated(words)) sets%direction = padded(words, direction_length)
         end if
         if (file%has("vector_first")) then
            allocate (vectors%names(0))
            if (file%has("vector_names")) then
               call file%get("vector_names", words, error)
               if (allocated(words)) vectors%names = padded(words, name_length)
            end if
            call file%get("vector_first", vectors%first, error)
            call file%get("vector_dofs", vectors%dofs, error)
            call file%get("vector_values", vectors%values, error)
         end if
      end associate
      if (allocated(error)) return
      if (sum_of(structure, figures) /= sum(1)) then
         call fail(error, "is damaged")
         return
      end if
      associate (reduction => structure%reduction)
         reduction%n_full = nint(figures(1))
         reduction%reach = reach_t(.true., figures(2))
         reduction%error = figures(3)
         reduction%seconds = figures(4)
         reduction%bytes = figures(5)
      end associate

   contains

      subroutine read_matrix(name, matrix)
         character(*), intent(in) :: name
         real(wp), allocatable, intent(out) :: matrix(:, :)
         type(h5_dataset_t) :: dataset

         if (allocated(error)) return
         call file%open_dataset(name, dataset, error)
         if (allocated(error)) return
         allocate (matrix(size(labels), size(labels)))
         call dataset%read(matrix, error)
         call dataset%close()
      end subroutine read_matrix
   end subroutine read_parts

   pure function padded(words, length) result(longer)
      character(*), intent(in) :: words(:)
      integer, intent(in) :: length
      character(length) :: longer(size(words))

      longer = words
   end function padded

   !> Checksum of all that is read.
   integer function sum_of(structure, figures) result(sum)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: figures(:)
      character(label_length) :: label
      character(unit_length) :: unit
      integer :: i

      sum = checksum(0, figures)
      associate (n => structure%n_dofs)
         sum = checksum(sum, reshape(structure%mass, [n*n]))
         sum = checksum(sum, reshape(structure%damping, [n*n]))
         sum = checksum(sum, reshape(structure%stiffness, [n*n]))
         do i = 1, n
            label = structure%labels(i)
            unit = structure%units(i)
            sum = checksum(checksum(sum, label), unit)
         end do
      end associate
      associate (sets => structure%sets, vectors => structure%vectors)
         if (allocated(sets%names)) then
            sum = checksum(checksum(checksum(sum, sets%first), sets%nodes), sets%node_of)
            do i = 1, size(sets%names)
               sum = checksum(sum, sets%names(i))
            end do
            do i = 1, size(sets%direction)
               sum = checksum(sum, sets%direction(i))
            end do
         end if
         if (allocated(vectors%names)) then
            sum = checksum(checksum(checksum(sum, vectors%first), vectors%dofs), vectors%values)
            do i = 1, size(vectors%names)
               sum = checksum(sum, vectors%names(i))
            end do
         end if
      end associate
   end function sum_of
end module hb_reduction_file
